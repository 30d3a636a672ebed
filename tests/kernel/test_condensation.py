"""Matrices without some of their variables: dense algebra says what is left, and how what is gone follows."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from kernel.test_factor_calls import matrices
from teamslam import kernel
from teamslam.errors import ModelError
from teamslam.kernel import BlockPattern, Condensation, NotPositiveDefinite


def condensed(pattern: BlockPattern, H: np.ndarray, gone: np.ndarray, **options: bool) -> Condensation:
    rows = sp.csr_array(H)
    return Condensation(pattern.dofs, rows.data, rows.indices, rows.indptr, gone, **options)


def dense_of(found: Condensation, size: int) -> np.ndarray:
    return sp.csr_array(found.sparse_rows(), shape=(size, size)).toarray()


@given(matrices(), st.floats(0.0, 1.0), st.booleans())
def test_what_is_left_is_the_schur_complement(case, share, frugal):
    rng, pattern, _, H = case
    asked = rng.random(len(pattern.dofs)) < share
    found = condensed(pattern, H, asked, frugal=frugal)
    assert not (found.gone & ~asked).any()
    assert frugal or (found.gone == asked).all()
    b = np.repeat(found.gone, pattern.dofs)
    solved = np.linalg.solve(H[np.ix_(b, b)], H[np.ix_(b, ~b)])
    left = dense_of(found, int((~b).sum()))
    np.testing.assert_allclose(left, H[np.ix_(~b, ~b)] - H[np.ix_(~b, b)] @ solved, atol=1e-10)
    shift = rng.normal(size=int((~b).sum()))
    np.testing.assert_allclose(found.follow(shift), -solved @ shift, atol=1e-10)


@given(matrices(), st.floats(0.0, 1.0))
def test_frugally_it_never_holds_more_numbers(case, share):
    rng, pattern, values, H = case
    found = condensed(pattern, H, rng.random(len(pattern.dofs)) < share, frugal=True)
    assert len(found.sparse_rows()[0]) <= len(pattern.sparse_rows(values)[0])


@given(matrices())
def test_the_number_of_threads_changes_no_bit(case):
    rng, pattern, _, H = case
    gone = rng.random(len(pattern.dofs)) < 0.7
    before, found = kernel.threads(), []
    try:
        for threads in (1, 3):
            kernel.set_threads(threads)
            found.append(condensed(pattern, H, gone).sparse_rows())
    finally:
        kernel.set_threads(before)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_not_determined_is_named():
    H = np.diag([1.0, 1.0, 0.0, 0.0, 1.0, 1.0])
    pattern = BlockPattern.from_pairs([2, 2, 2], [0], [0])
    with pytest.raises(NotPositiveDefinite) as problem:
        condensed(pattern, H, np.array([True, True, False]))
    assert problem.value.variable == 1
    with pytest.raises(ModelError, match="gone: found shape"):
        condensed(pattern, H, np.array([True]))
