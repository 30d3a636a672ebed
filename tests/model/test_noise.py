"""Laws of whitening by information, singular or not: what is measured, what is left open, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from strategies import generators
from teamslam.errors import ModelError
from teamslam.geometry import Array
from teamslam.model import ranks, variances, whitening, whitening_of_information


def singular(rng: np.random.Generator, size: int, rank: int) -> Array:
    """A random information of this rank, its numbers of different units."""
    directions = np.linalg.qr(rng.normal(size=(size, size)))[0][:, :rank] * np.exp(rng.normal(size=rank))
    units = 10.0 ** rng.integers(-3, 4, size)
    return np.asarray(units[:, None] * (directions @ directions.T) * units)


sizes = st.tuples(st.integers(1, 6), st.integers(1, 6)).map(lambda pair: (max(pair), min(pair)))


@given(generators, sizes)
def test_information_of_any_rank_is_whitened(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    """W'W = information, with one row for each direction that it has."""
    size, rank = shape
    information = singular(rng, size, rank)
    w = whitening_of_information(information)
    scale = np.sqrt(np.diag(information))
    assert_allclose((w.T @ w) / scale / scale[:, None], information / scale / scale[:, None], atol=1e-12)
    assert ranks(w) == rank
    assert not np.triu(w, 1).any()


@given(generators, sizes, st.integers(6, 12))
def test_digits_lost_in_writing_leave_what_is_open_open(
    rng: np.random.Generator, shape: tuple[int, int], digits: int
) -> None:
    """A file's six digits may turn a zero eigenvalue into one a little below, or above."""
    size, rank = shape
    exact = singular(rng, size, rank)
    written = np.array([[float(f"{x:.{digits - 1}e}") for x in row] for row in exact])
    w, scale = whitening_of_information(written), np.sqrt(np.diag(exact))
    assert rank <= ranks(w) <= size
    assert_allclose((w.T @ w) / scale / scale[:, None], exact / scale / scale[:, None], atol=30.0 * 10.0**-digits)


@given(generators, st.integers(1, 6))
def test_a_number_without_information_has_a_row_of_zeros(rng: np.random.Generator, size: int) -> None:
    information = singular(rng, size, size)
    open_ = rng.integers(size)
    information[open_] = information[:, open_] = 0.0
    if not information.any():
        with pytest.raises(ModelError, match="says nothing"):
            whitening_of_information(information)
        return
    w = whitening_of_information(information)
    assert not w[open_].any() and not w[:, open_].any() and ranks(w) == size - 1
    assert np.flatnonzero(np.isinf(variances(w))).tolist() == [open_]


@given(generators, sizes)
def test_variances_are_those_of_the_inverse_or_infinite(rng: np.random.Generator, shape: tuple[int, int]) -> None:
    size, rank = shape
    information = singular(rng, size, rank)
    found = variances(whitening_of_information(information))
    if rank == size:
        scale = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / scale / scale[:, None])
        assert_allclose(found * scale**2, np.diag(inverse), rtol=1e-6)
    else:  # a random direction that is left open concerns every number
        assert np.isinf(found).all()


def test_variances_of_what_a_singular_row_does_measure() -> None:
    w = whitening_of_information(np.stack([np.diag([4.0, 0.0, 25.0]), np.diag([4.0, 9.0, 25.0])]))
    assert_allclose(variances(w), [[0.25, np.inf, 0.04], [0.25, 1.0 / 9.0, 0.04]])


def test_both_ways_to_whiten_agree() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 3.0]])
    assert_allclose(whitening_of_information(np.linalg.inv(covariance)), whitening(covariance))


@pytest.mark.parametrize(
    "information, reason",
    [
        (np.zeros((2, 2)), "says nothing"),
        (np.diag([1.0, -1.0]), "negative eigenvalue"),
        (np.array([[0.0, 1.0], [1.0, 4.0]]), "negative eigenvalue"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), "negative eigenvalue"),
        (np.array([[1.0, 0.5], [0.4, 1.0]]), "not symmetric"),
        (np.array([[1.0, np.nan], [np.nan, 1.0]]), "not finite"),
    ],
)
def test_what_is_no_information_is_refused(information: Array, reason: str) -> None:
    with pytest.raises(ModelError, match=f"information 0 .*{reason}"):
        whitening_of_information(information)
    with pytest.raises(ModelError, match=f"information 2 .*{reason}"):
        whitening_of_information(np.stack([np.eye(2), np.eye(2), information]))
