"""Laws of steps that are carried by frames: to first order the plain step; what turns as a body stays a body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kernel.formulas import DOFS, POINT2, POINT3, POSE2, POSE3, Variables, exp, lift, split
from teamslam.errors import ModelError
from teamslam.kernel import Problem

# A planar frame with planar and spatial things and frames, one of these carrying more; two variables on their own.
KINDS = np.array([POSE3, POINT3, POSE2, POINT2, POSE2, POINT2, POSE3, POINT3, POSE2, POINT3])
HOMES = np.array([6, 0, 4, 2, -1, 4, 4, 6, -1, -1])


def in_space(kind: int, x: np.ndarray) -> np.ndarray:
    if kind in (POSE2, POSE3):
        return lift(x)
    return np.r_[x, np.zeros(3 - len(x))]


def within(frame: np.ndarray, x: np.ndarray) -> np.ndarray:
    """X_f^-1 X of poses and points in space."""
    T, R = split(frame)
    return np.r_[R.T @ (x[:3] - T), (R.T @ x[3:].reshape(3, -1)).ravel()]


def turned_about(frame: np.ndarray, step: np.ndarray, kind: int, x: np.ndarray) -> np.ndarray:
    """d of a thing that goes along rigidly with the first-order motion `step` of its frame, all in space."""
    T, R = split(frame)
    w = R @ step[3:]
    shift = step[:3] + np.cross(w, x[:3] - T)
    whole = np.r_[shift, split(x)[1].T @ w] if kind in (POSE2, POSE3) else shift
    return whole[{POSE2: [0, 1, 5], POSE3: range(6), POINT2: [0, 1], POINT3: range(3)}[kind]]


@st.composite
def steps(draw: st.DrawFn) -> tuple[Variables, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    variables = Variables(KINDS, rng.random(len(KINDS)) < 0.2)
    return variables, variables.random_state(rng), rng.normal(0, 1.0, variables.dof_start[-1])


@given(steps())
def test_to_first_order_it_is_the_plain_step(case: tuple[Variables, np.ndarray, np.ndarray]) -> None:
    variables, state, delta = case
    plain, carried = Problem(variables.kinds, variables.fixed), Problem(variables.kinds, variables.fixed)
    carried.set_homes(HOMES)
    small, smaller = (
        np.abs(carried.retract(state, size * delta) - plain.retract(state, size * delta)).max() for size in (1e-3, 1e-4)
    )
    assert small < 1e-3
    assert smaller < small / 50.0 + 1e-13


@given(steps())
def test_what_is_held_or_has_no_home_moves_as_ever(case: tuple[Variables, np.ndarray, np.ndarray]) -> None:
    variables, state, delta = case
    plain, carried = Problem(variables.kinds, variables.fixed), Problem(variables.kinds, variables.fixed)
    carried.set_homes(HOMES)
    before, after = plain.retract(state, delta), carried.retract(state, delta)
    for v in np.flatnonzero(variables.fixed | (HOMES < 0)):
        np.testing.assert_array_equal(variables.of(after, v), variables.of(before, v))


@given(st.integers(0, 2**32))
def test_a_body_that_turns_is_not_bent(seed: int) -> None:
    rng = np.random.default_rng(seed)
    variables = Variables(KINDS, np.zeros(len(KINDS), bool))
    state = variables.random_state(rng)
    before = [in_space(kind, variables.of(state, v)) for v, kind in enumerate(KINDS)]
    delta = np.zeros(variables.dof_start[-1])
    root = 4
    step = rng.normal(0, 1.0, 3)
    lifted = np.r_[step[:2], 0.0, 0.0, 0.0, step[2]]
    for v, kind in enumerate(KINDS):
        if _root(v) == root:
            delta[variables.dof_start[v] :][: DOFS[kind]] = turned_about(before[root], lifted, kind, before[v])
    problem = Problem(variables.kinds, variables.fixed)
    problem.set_homes(HOMES)
    moved = problem.retract(state, delta)
    after = [in_space(kind, variables.of(moved, v)) for v, kind in enumerate(KINDS)]
    T, R = split(before[root])
    np.testing.assert_allclose(after[root][3:], (R @ exp(lifted[3:])).ravel(), atol=1e-13)
    np.testing.assert_allclose(after[root][:3], T + lifted[:3], atol=1e-13)
    for v in range(len(KINDS)):
        if _root(v) == root:
            np.testing.assert_allclose(within(after[root], after[v]), within(before[root], before[v]), atol=1e-12)


def _root(v: int) -> int:
    return v if HOMES[v] < 0 else _root(int(HOMES[v]))


def test_a_long_row_of_frames_keeps_its_rotations() -> None:
    n, rng = 2000, np.random.default_rng(2)
    problem, variables = Problem(np.full(n, POSE3)), Variables(np.full(n, POSE3), np.zeros(n, bool))
    problem.set_homes(np.arange(n) - 1)
    state = problem.retract(variables.random_state(rng), rng.normal(0, 0.1, 6 * n))
    R = state.reshape(n, 12)[:, 3:].reshape(n, 3, 3)
    np.testing.assert_allclose(np.swapaxes(R, 1, 2) @ R, np.tile(np.eye(3), (n, 1, 1)), atol=1e-14)


def test_homes_that_make_no_sense_are_refused() -> None:
    kinds = [POSE2, POSE3, POINT2, POINT3, POSE2]
    wrong = [
        [5, -1, -1, -1, -1], [-2, -1, -1, -1, -1], [-1, 3, -1, -1, -1], [-1, -1, 1, -1, -1], [4, -1, -1, -1, 0],
        [0, -1, -1, -1, -1], [-1, -1, -1, -1],
    ]  # fmt: skip
    for homes in wrong:
        with pytest.raises(ModelError):
            Problem(kinds).set_homes(homes)
    Problem(kinds).set_homes([-1, 0, 4, 1, 0])
