"""Laws of the retraction: x (+) 0 = x, (x (+) d) (-) x = d, and rotations stay rotations."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kernel.formulas import DOFS, POSE2, POSE3, Variables, minus, retract, split
from teamslam.kernel import Problem


@st.composite
def moves(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    variables = Variables(rng.integers(0, 4, 8), rng.random(8) < 0.25)
    size = draw(st.sampled_from([1e-12, 1e-9, 1e-6, 5e-4, 1e-3, 2e-3, 0.1, 1.0]))
    return variables, variables.random_state(rng), rng.normal(0, size, variables.dof_start[-1])


@given(moves())
def test_retract_is_its_definition(case):
    variables, state, delta = case
    moved = Problem(variables.kinds, variables.fixed).retract(state, delta)
    for v, kind in enumerate(variables.kinds):
        before, after = variables.of(state, v), variables.of(moved, v)
        if variables.fixed[v]:
            np.testing.assert_array_equal(after, before)
            continue
        d = delta[variables.dof_start[v] : variables.dof_start[v] + DOFS[kind]]
        np.testing.assert_allclose(after, retract(kind, before, d), atol=1e-14, rtol=1e-14)
        turned = d[2 if kind == POSE2 else 3 :] if kind in (POSE2, POSE3) else d[:0]
        if np.linalg.norm(turned) < np.pi:
            np.testing.assert_allclose(minus(after, before), d, atol=1e-13)


@given(moves())
def test_no_move_changes_nothing(case):
    variables, state, delta = case
    np.testing.assert_array_equal(Problem(variables.kinds, variables.fixed).retract(state, 0 * delta), state)


def test_rotations_stay_rotations_over_many_moves():
    rng = np.random.default_rng(1)
    problem = Problem([POSE2, POSE3])
    state = Variables(np.array([POSE2, POSE3]), np.zeros(2, bool)).random_state(rng)
    for _ in range(5000):
        state = problem.retract(state, rng.normal(0, 0.5, 9))
    for pose in (state[:6], state[6:]):
        _, R = split(pose)
        np.testing.assert_allclose(R.T @ R, np.eye(len(R)), atol=1e-14)
        assert np.linalg.det(R) > 0
