"""The curvature that H may hold: with all of it, H is half the second derivative of the cost, for every term."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kernel.formulas import Variables, combinations, dense, measurement, residual
from kernel.test_assembly import native, problems
from kernel.test_submap_term import submaps
from teamslam.errors import ModelError
from teamslam.kernel import Problem

STEP = 1e-5


def assert_second_derivative(problem: Problem, handles, state: np.ndarray) -> None:
    """d'Hd is how g falls along x (+) t d."""
    for handle in handles:
        problem.set_curvature(handle, "all")
    _, _, values = problem.linearise(state)
    matrix = dense(problem.pattern, values)
    assume(np.isfinite(matrix).all())
    for direction in np.random.default_rng(0).standard_normal((3, len(matrix))):
        slopes = []
        for size in (STEP, 2.0 * STEP):
            ahead, behind = (problem.linearise(problem.retract(state, s * direction))[1] for s in (size, -size))
            slopes.append(float((behind - ahead) @ direction) / (2.0 * size))
        scale = 1.0 + np.abs(matrix).max() * float(direction @ direction)
        assume(abs(slopes[1] - slopes[0]) < 1e-6 * scale)  # else a kink is near: half a turn, or Huber's corner
        assert abs(float(direction @ matrix @ direction) - slopes[0]) < 1e-5 * scale


@pytest.mark.parametrize("model, dim, kinds", combinations(), ids=str)
@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_of_every_model(model: str, dim: int, kinds: tuple[int, ...], seed: int) -> None:
    """Each alone: among others, what one row holds wrongly may be small."""
    rng, n = np.random.default_rng(seed), len(kinds)
    variables = Variables(np.array(kinds), np.zeros(n, bool))
    state, z = variables.random_state(rng), measurement(rng, model, dim)
    rows = len(residual(model, dim, z, None, [variables.of(state, v) for v in range(n)]))
    problem = Problem(variables.kinds, variables.fixed)
    handle = problem.add_table(model, dim, [range(n)], [z], rng.normal(size=(1, rows, rows)))
    assert_second_derivative(problem, [handle], state)


@given(problems())
def test_of_tables(case) -> None:
    variables, tables, state = case
    problem, handles = native(variables, tables)
    if problem.pattern.scalars:
        assert_second_derivative(problem, handles, state)


@given(submaps())
def test_of_submaps(case) -> None:
    variables, state, base, members, own_kinds, estimate, pattern, values, eta = case
    problem = Problem(variables.kinds, variables.fixed)
    handle = problem.add_submap(base, members, own_kinds, estimate, pattern, values, eta)
    if problem.pattern.scalars:
        assert_second_derivative(problem, [handle], state)


def test_curvature_may_come_and_go() -> None:
    problem = Problem([0, 2])
    handle = problem.add_table("range", 2, [[0, 1]], [[3.0]], np.eye(1)[None])
    state = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    before = problem.linearise(state)
    problem.set_curvature(handle, "all")
    cost, gradient, bent = problem.linearise(state)
    assert cost == before[0] and (gradient == before[1]).all() and (bent != before[2]).any()
    problem.set_curvature(handle, "none")
    np.testing.assert_array_equal(problem.linearise(state)[2], before[2])
    with pytest.raises(ModelError, match="expected one of none, losses, all"):
        problem.set_curvature(handle, "some")
    with pytest.raises(ModelError, match="no table or submap"):
        problem.set_curvature(7, "all")
