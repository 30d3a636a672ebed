"""Many submaps added at once, their information by sparse rows, are the submaps added one by one, by blocks."""

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.errors import ModelError
from teamslam.kernel import BlockPattern, Problem

POSE2, POINT2 = 0, 2
KINDS = np.array([POSE2, POSE2, POSE2, POINT2, POINT2, POINT2])
SUBMAPS = [(0, [1, 3, 4]), (1, [2, 4, 5]), (-1, [0, 5])]  # base, members


def states(rng: np.random.Generator, kinds: np.ndarray) -> np.ndarray:
    out = []
    for kind in kinds:
        angle = rng.uniform(-3.0, 3.0)
        turn = [np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)] if kind == POSE2 else []
        out.append(np.r_[rng.normal(size=2), turn])
    return np.concatenate(out)


def information(rng: np.random.Generator, dofs: np.ndarray) -> np.ndarray:
    """Positive definite, with no coupling between the first two members."""
    root = rng.normal(size=(dofs.sum(), dofs.sum()))
    root[: dofs[0], dofs[0] : dofs[0] + dofs[1]] = 0.0
    root[dofs[0] :, : dofs[0]] = 0.0
    return root.T @ root + np.eye(dofs.sum())


def blocks(matrix: np.ndarray, dofs: np.ndarray) -> tuple[BlockPattern, np.ndarray]:
    start = np.r_[0, np.cumsum(dofs)]
    place = [slice(start[v], start[v + 1]) for v in range(len(dofs))]
    coupled = [(r, c) for c in range(len(dofs)) for r in range(c + 1, len(dofs)) if matrix[place[r], place[c]].any()]
    first, second = np.array(coupled, int).reshape(-1, 2).T
    pattern = BlockPattern.from_pairs(dofs, first, second)
    column = np.repeat(np.arange(len(dofs)), np.diff(pattern.column_start))
    numbers = [matrix[place[r], place[c]].ravel("F") for r, c in zip(pattern.row, column, strict=True)]
    return pattern, np.concatenate(numbers)


@pytest.mark.parametrize("sloped", [False, True])
def test_at_once_or_one_by_one_is_the_same_to_the_bit(sloped: bool) -> None:
    rng = np.random.default_rng(1)
    single, many = Problem(KINDS, KINDS == -1), Problem(KINDS, KINDS == -1)
    parts = []
    for base, members in SUBMAPS:
        kinds = KINDS[members]
        dofs = np.where(kinds == POSE2, 3, 2)
        matrix, local = information(rng, dofs), states(rng, kinds)
        eta = rng.normal(size=dofs.sum()) if sloped else None
        single.add_submap(base, members, kinds, local, *blocks(matrix, dofs), eta)
        parts.append((members, kinds, local, sp.csr_array(matrix), eta))
    rows = [p[3] for p in parts]
    handles = many.add_submaps(
        [base for base, _ in SUBMAPS],
        [len(p[0]) for p in parts],
        np.concatenate([p[0] for p in parts]),
        np.concatenate([p[1] for p in parts]),
        np.concatenate([p[2] for p in parts]),
        np.concatenate([m.indptr for m in rows]),
        [m.indices for m in rows],
        [m.data for m in rows],
        np.concatenate([p[4] for p in parts]) if sloped else None,
    )
    assert handles == [0, 1, 2]
    at = states(rng, KINDS)
    for mine, theirs in zip(many.linearise(at), single.linearise(at), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(many.pattern.row, single.pattern.row)


def test_what_does_not_fit_is_refused() -> None:
    good = dict(
        bases=[-1], counts=[1], members=[3], kinds=[POINT2], state=[0.0, 0.0],
        row_start=[0, 1, 2], columns=[[0, 1]], values=[[1.0, 1.0]],
    )  # fmt: skip
    assert Problem(KINDS).add_submaps(**good) == [0]
    assert Problem(KINDS).add_submaps([], [], [], [], [], [], [], []) == []
    bad = [
        ("bases", [9]), ("counts", [0]), ("members", [77]), ("kinds", [POSE2]), ("kinds", [8]), ("state", [0.0]),
        ("state", [0.0, np.nan]), ("row_start", [1, 1, 2]), ("row_start", [0, 3, 2]), ("row_start", [0, 1]),
        ("columns", [[0, 2]]), ("columns", [[-1, 0]]), ("columns", [[0.0, 1.0]]), ("columns", []),
        ("columns", [[0, 2**32 + 1]]), ("values", [[1.0]]), ("values", [[1.0, np.inf]]), ("values", [["a", "b"]]),
    ]  # fmt: skip
    for name, wrong in bad:
        with pytest.raises(ModelError):
            Problem(KINDS).add_submaps(**good | {name: wrong})
    with pytest.raises(ModelError, match="do not rise"):
        Problem(KINDS).add_submaps(**good | {"row_start": [0, 2, 2], "columns": [[1, 0]]})


def test_blocks_become_sparse_rows() -> None:
    rng = np.random.default_rng(2)
    dofs = np.array([3, 2, 6, 2])
    matrix = information(rng, dofs)
    pattern, numbers = blocks(matrix, dofs)
    data, columns, start = pattern.sparse_rows(numbers)
    rows = sp.csr_array((data, columns, start), shape=matrix.shape)
    np.testing.assert_array_equal(rows.toarray(), matrix)
    assert rows.has_canonical_format
    with pytest.raises(ModelError):
        pattern.sparse_rows(numbers[1:])


def test_the_sharpest_number_is_on_a_diagonal() -> None:
    problem = Problem(KINDS)
    assert problem.sharpest() == 0.0
    for most in (4.0, 9.0, 1.0):
        matrix = np.array([[1.0, -0.5], [-0.5, most]])
        problem.add_submap(-1, [3], [POINT2], [0.0, 0.0], *blocks(matrix, np.array([2])))
    assert problem.sharpest() == 9.0


def test_the_slope_alone_is_that_of_the_linearisation() -> None:
    rng = np.random.default_rng(3)
    for fixed in (-1, 0):
        problem = Problem(KINDS, np.arange(len(KINDS)) == fixed)
        for base, members in SUBMAPS:
            kinds = KINDS[members]
            dofs = np.where(kinds == POSE2, 3, 2)
            numbers = blocks(information(rng, dofs), dofs)
            problem.add_submap(base, members, kinds, states(rng, kinds), *numbers, rng.normal(size=dofs.sum()))
        at = states(rng, KINDS)
        cost, gradient, _ = problem.linearise(at)
        assert problem.slope(at)[0] == pytest.approx(cost, rel=1e-13)
        np.testing.assert_allclose(problem.slope(at)[1], gradient, rtol=1e-12, atol=1e-12 * np.abs(gradient).max())


def test_blocks_of_a_user_have_no_slope_alone() -> None:
    problem = Problem(KINDS)
    problem.add_blocks([[0]], 2)
    with pytest.raises(ModelError, match="slope"):
        problem.slope(states(np.random.default_rng(4), KINDS))
