"""The Python face of factors and patterns: order of calls, use again, refusals."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from kernel.formulas import dense, on_pattern
from teamslam.errors import ModelError, SolveError
from teamslam.kernel import Analysis, BlockPattern, Factor, NotPositiveDefinite


@st.composite
def matrices(draw):
    """A positive definite matrix of random blocks (H of random couplings), with its pattern."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n = draw(st.integers(1, 40))
    dofs = rng.choice([2, 3, 6], n)
    start = np.concatenate([[0], np.cumsum(dofs)])
    pairs = rng.integers(0, n, (draw(st.integers(0, 3 * n)), 2))
    H = np.eye(start[-1])
    for a, b in pairs:
        columns = np.unique(np.concatenate([np.arange(start[a], start[a + 1]), np.arange(start[b], start[b + 1])]))
        J = rng.normal(size=(4, len(columns)))
        H[np.ix_(columns, columns)] += J.T @ J
    pattern = BlockPattern.from_pairs(dofs, pairs[:, 0], pairs[:, 1])
    return rng, pattern, on_pattern(pattern, H), H


@given(matrices())
def test_a_factor_serves_again(case):
    rng, pattern, values, H = case
    factor = Factor(pattern)
    b, damping = rng.normal(size=len(H)), rng.random(len(H))
    factor.factor(values)
    first = factor.solve(b)
    factor.factor(values, damping)
    np.testing.assert_allclose(factor.solve(b), np.linalg.solve(H + np.diag(damping), b), atol=1e-10)
    factor.factor(values)
    np.testing.assert_array_equal(factor.solve(b), first)


def test_the_order_of_calls_is_kept():
    pattern = BlockPattern.from_pairs([2, 3], [0], [1])
    factor = Factor(Analysis(pattern, last=[1]))
    values = on_pattern(pattern, np.eye(5))
    with pytest.raises(SolveError, match="call factor first"):
        factor.solve(np.ones(5))
    with pytest.raises(SolveError, match="call eliminate first"):
        factor.back_substitute(np.ones(3), np.ones(5))
    factor.eliminate(values, np.ones(5))
    with pytest.raises(SolveError, match="call factor first"):
        factor.diagonal_inverse()
    factor.factor(values)
    np.testing.assert_allclose(factor.solve(np.ones(5)), np.ones(5))
    with pytest.raises(NotPositiveDefinite):
        factor.factor(np.full(pattern.size, np.nan))
    with pytest.raises(SolveError, match="call factor first"):
        factor.solve(np.ones(5))


def test_what_does_not_fit_is_refused():
    pattern = BlockPattern.from_pairs([2, 3], [0], [1])
    for bad in ({"ordering": "best"}, {"positions": np.ones((3, 3))}, {"positions": np.full((2, 3), np.nan)},
                {"last": [2]}, {"last": [-1]}, {"last": [1, 1]}, {"ordering": "geometric"}):  # fmt: skip
        with pytest.raises(ModelError):
            Analysis(pattern, **bad)
    with pytest.raises(ModelError, match="no variables"):
        Factor(BlockPattern.from_pairs([], [], []))
    factor = Factor(pattern)
    with pytest.raises(ModelError, match="values: found shape"):
        factor.factor(np.ones(3))
    with pytest.raises(ModelError, match="'last'"):
        factor.eliminate(on_pattern(pattern, np.eye(5)))


@pytest.mark.parametrize(
    ("dofs", "column_start", "row"),
    [
        ([2, 2], [0, 1], [0, 1]),
        ([2, 2], [0, 1, 2], [0]),
        ([2, 2], [0, 1, 2], [0, 0]),
        ([2, 2], [0, 2, 3], [0, 2, 1]),
        ([2, 2, 2], [0, 3, 4, 5], [0, 2, 1, 1, 2]),
        ([2, 0], [0, 1, 2], [0, 1]),
        ([2, 2], [0, 3, 2], [0, 1, 1]),
        ([2, 2], [1, 2, 3], [0, 0, 1]),
        ([[2, 2]], [0, 1, 2], [0, 1]),
        ([2.0, 2.0], [0, 1, 2], [0, 1]),
    ],
)
def test_patterns_that_are_none_are_refused(dofs, column_start, row):
    with pytest.raises(ModelError):
        BlockPattern(np.array(dofs), np.array(column_start), np.array(row))


def test_dense_and_on_pattern_are_inverse():
    rng = np.random.default_rng(1)
    pattern = BlockPattern.from_pairs([2, 3, 6], [0, 2], [1, 0])
    values = on_pattern(pattern, dense(pattern, rng.normal(size=pattern.size)))
    np.testing.assert_array_equal(on_pattern(pattern, dense(pattern, values)), values)


@given(matrices())
def test_factors_share_an_analysis(case):
    rng, pattern, values, H = case
    analysis = Analysis(pattern)
    first, second = Factor(analysis), Factor(analysis)
    first.factor(values)
    second.factor(2.0 * values)
    b = rng.normal(size=len(H))
    np.testing.assert_allclose(first.solve(b), 2.0 * second.solve(b), rtol=1e-12, atol=1e-12)


@given(matrices(), st.data())
def test_covariances_of_some_are_those_of_all(case, data):
    _, pattern, values, _ = case
    factor = Factor(pattern)
    factor.factor(values)
    every = factor.diagonal_inverse()
    some = data.draw(st.lists(st.integers(0, len(pattern.dofs) - 1), max_size=5))
    found = factor.diagonal_inverse(np.array(some, int))
    assert len(found) == len(some)
    for v, block in zip(some, found, strict=True):
        np.testing.assert_array_equal(block, every[v])
    with pytest.raises(ModelError, match="variables"):
        factor.diagonal_inverse([len(pattern.dofs)])


@given(matrices())
def test_blocks_become_rows_of_scalars_and_blocks_again(case):
    _, pattern, values, H = case
    data, columns, start = pattern.sparse_rows(values)
    np.testing.assert_array_equal(sp.csr_array((data, columns, start), H.shape).toarray(), H)
    again, numbers = BlockPattern.of_sparse_rows(pattern.dofs, data, columns, start)
    for name in ("dofs", "column_start", "row", "value_start", "scalar_start"):
        np.testing.assert_array_equal(getattr(again, name), getattr(pattern, name))
    np.testing.assert_array_equal(numbers, values)


def test_rows_of_scalars_that_are_none_are_refused():
    for columns, start, why in [
        ([1, 0, 0, 1], [0, 2, 4], "columns of row 0 do not rise"),
        ([0, 1, 0, 2], [0, 2, 4], "row 1 has columns 0 to 2"),
        ([0, 1, 0, 1], [1, 2, 4], "does not start at 0"),
    ]:
        with pytest.raises(ModelError, match=why):
            BlockPattern.of_sparse_rows([2], np.ones(4), columns, start)
