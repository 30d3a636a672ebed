"""Whole problems: H, g and cost are the sums over rows that the definitions say, for any number of threads."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kernel.formulas import (
    POINT2,
    POINT3,
    POSE2,
    POSE3,
    Variables,
    add_row,
    combinations,
    dense,
    jacobian,
    loss_weight,
    measurement,
    residual,
    rho,
)
from teamslam import kernel
from teamslam.kernel import LOSSES, MODELS, Problem


@pytest.mark.parametrize("loss", LOSSES)
def test_losses(loss):
    # One position measurement of sigma 1 at growing distance: cost and weight are those of the loss.
    k = 1.7
    for distance in np.linspace(0, 6, 25):
        problem = Problem([POINT2])
        problem.add_table("position", 2, [[0]], [[distance, 0.0]], np.eye(2)[None], loss=loss, scale=k)
        cost, gradient, values = problem.linearise(np.zeros(2))
        np.testing.assert_allclose(cost, rho(loss, k, distance**2), rtol=1e-13)
        if abs(distance - k) > 1e-2:
            weight = loss_weight(loss, k, distance**2)
            np.testing.assert_allclose(gradient, [weight * distance, 0.0], atol=1e-9)
            np.testing.assert_allclose(dense(problem.pattern, values), weight * np.eye(2), atol=1e-9)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_curvature_of_losses_is_their_second_derivative(loss):
    # Along one axis the cost is rho(x^2): its gradient is unchanged, and H is half its second derivative, which is
    # negative for far outliers. Across, and for rows of weight zero, nothing changes.
    k, step = 1.7, 1e-3
    for x in (0.3, 1.2, 1.6, 1.8, 2.5, 6.0):
        problem = Problem([POINT2])
        handle = problem.add_table("position", 2, [[0]], [[x, 0.0]], np.eye(2)[None], loss=loss, scale=k)
        _, plain_gradient, plain = problem.linearise(np.zeros(2))
        problem.set_curvature(handle, "losses")
        _, gradient, values = problem.linearise(np.zeros(2))
        second = (rho(loss, k, (x + step) ** 2) - 2 * rho(loss, k, x**2) + rho(loss, k, (x - step) ** 2)) / step**2
        np.testing.assert_allclose(gradient, plain_gradient, atol=1e-14)
        np.testing.assert_allclose(values.reshape(2, 2), np.diag([second / 2, plain[3]]), atol=1e-5)
        problem.set_weights(handle, [0.0])
        _, gradient, values = problem.linearise(np.zeros(2))
        assert not gradient.any() and not values.any()


@st.composite
def problems(draw):
    """A random mixed team: variables of all kinds in any order, tables of rows between any that fit."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n = draw(st.integers(1, 12))
    variables = Variables(rng.integers(0, 4, n), rng.random(n) < 0.2)
    tables = []
    for _ in range(draw(st.integers(0, 5))):
        model, dim = draw(st.sampled_from(MODELS)), draw(st.sampled_from((2, 3)))
        known = {kinds for m, d, kinds in combinations() if (m, d) == (model, dim)}
        arity = 1 if model in ("position", "pose") else 2
        index = [rng.permutation(n)[:arity] for _ in range(20)] if n >= arity else []
        index = [row for row in index if tuple(variables.kinds[row]) in known]
        if not index:
            continue
        z = np.array([measurement(rng, model, dim) for _ in index])
        sensor = measurement(rng, "pose", dim) if draw(st.booleans()) else None
        if sensor is not None and any(variables.kinds[row[0]] in (POINT2, POINT3) for row in index):
            sensor = None
        r = {"relative_pose": 3 * dim - 3, "pose": 3 * dim - 3, "range": 1, "bearing": dim - 1, "corners": 8}.get(
            model, dim
        )
        whitening = rng.normal(size=(1 if draw(st.booleans()) else len(index), r, r))
        loss = draw(st.sampled_from(LOSSES))
        weights = rng.random(len(index)) if draw(st.booleans()) else None
        tables.append((model, dim, np.array(index), z, whitening, sensor, loss, rng.uniform(0.5, 3.0), weights))
    return variables, tables, variables.random_state(rng)


def native(variables, tables):
    problem = Problem(variables.kinds, variables.fixed)
    handles = []
    for *table, weights in tables:
        handles.append(problem.add_table(*table))
        problem.set_weights(handles[-1], weights)
    return problem, handles


def reference(variables, tables, state):
    """Cost, g and H by the formulas."""
    n = variables.dof_start[-1]
    cost, g, H = 0.0, np.zeros(n), np.zeros((n, n))
    for model, dim, index, z, whitening, sensor, loss, scale, weights in tables:
        for i, row in enumerate(index):
            at = [variables.of(state, v) for v in row]
            W = whitening[i if len(whitening) > 1 else 0]
            e = W @ residual(model, dim, z[i], sensor, at)
            J = W @ jacobian(model, dim, z[i], sensor, variables.kinds[row], at)
            given_weight = 1.0 if weights is None else weights[i]
            w = given_weight * loss_weight(loss, scale, e @ e, step=1e-5 * (1 + e @ e))
            cost += given_weight * rho(loss, scale, e @ e)
            add_row(variables, row, J, w * e, w * J, H, g)
    return cost, g, H


@given(problems())
def test_problems_agree_with_the_sum_over_their_rows(case):
    variables, tables, state = case
    problem, handles = native(variables, tables)
    cost, g, values = problem.linearise(state)
    expected_cost, expected_g, expected_H = reference(variables, tables, state)
    if not np.isfinite(expected_H).all():
        return  # a rotation too near to a half turn for differences
    scale = 1 + np.abs(expected_H).max(initial=0.0)
    np.testing.assert_allclose(cost, expected_cost, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(problem.cost(state), cost, rtol=1e-13)
    np.testing.assert_allclose(problem.slope(state)[0], cost, rtol=1e-13)
    np.testing.assert_allclose(problem.slope(state)[1], g, atol=1e-11 * scale)
    np.testing.assert_allclose(g, expected_g, atol=1e-6 * scale)
    np.testing.assert_allclose(dense(problem.pattern, values), expected_H, atol=1e-6 * scale)
    for handle, (model, dim, index, z, whitening, sensor, *_) in zip(handles, tables, strict=True):
        expected = [
            whitening[i if len(whitening) > 1 else 0]
            @ residual(model, dim, z[i], sensor, [variables.of(state, v) for v in row])
            for i, row in enumerate(index)
        ]
        np.testing.assert_allclose(problem.residuals(state, handle), expected, atol=1e-10)


def test_weights_may_come_and_go():
    rng = np.random.default_rng(1)
    problem = Problem([POINT3] * 5)
    index = np.array([[3], [1], [3], [0], [4]])
    handle = problem.add_table("position", 3, index, rng.normal(size=(5, 3)), np.eye(3)[None])
    state = rng.normal(size=15)
    squared = np.sum(problem.residuals(state, handle) ** 2, 1)
    assert problem.cost(state) == pytest.approx(squared.sum())
    weights = rng.random(5)
    problem.set_weights(handle, weights)
    assert problem.cost(state) == pytest.approx(weights @ squared)
    assert problem.linearise(state)[0] == pytest.approx(weights @ squared)
    problem.set_weights(handle, None)
    assert problem.cost(state) == pytest.approx(squared.sum())


@given(problems(), st.integers(0, 2**32 - 1))
def test_another_whitening_is_as_if_it_had_been_given(case, seed):
    variables, tables, state = case
    rng = np.random.default_rng(seed)
    others = [
        (model, dim, index, z, rng.normal(size=(1 if rng.random() < 0.5 else len(index), *whitening.shape[1:])), *rest)
        for model, dim, index, z, whitening, *rest in tables
    ]
    problem, handles = native(variables, tables)
    used = rng.random() < 0.5
    if used:
        problem.linearise(state)
    for handle, other in zip(handles, others, strict=True):
        problem.set_whitening(handle, other[4])
    expected, its = native(variables, others)
    for found, wanted in zip(problem.linearise(state), expected.linearise(state), strict=True):
        np.testing.assert_array_equal(found, wanted)
    for mine, theirs in zip(handles, its, strict=True):
        np.testing.assert_array_equal(problem.residuals(state, mine), expected.residuals(state, theirs))


def test_blocks_of_the_caller_join_those_of_the_tables():
    # A table of relative poses, once by the kernel and once by hand in NumPy, in either order of the variables.
    rng = np.random.default_rng(2)
    variables = Variables(np.array([POSE3, POINT3, POSE3, POSE2, POSE3]), np.array([True, False, False, False, False]))
    index = np.array([[0, 2], [4, 2], [2, 4], [4, 0]])
    z = np.array([measurement(rng, "relative_pose", 3) for _ in index])
    state = variables.random_state(rng)
    by_kernel, by_hand = Problem(variables.kinds, variables.fixed), Problem(variables.kinds, variables.fixed)
    by_kernel.add_table("relative_pose", 3, index, z, np.eye(6)[None])
    handle = by_hand.add_blocks(index, 6)
    at = [[variables.of(state, v) for v in row] for row in index]
    e = np.array([residual("relative_pose", 3, z[i], None, at[i]) for i in range(4)])
    J = np.array([jacobian("relative_pose", 3, z[i], None, (POSE3, POSE3), at[i]) for i in range(4)])
    cost, g, values = by_kernel.linearise(state)
    hand_cost, hand_g, hand_values = by_hand.linearise(state, {handle: (e, J, float(np.sum(e**2)))})
    np.testing.assert_array_equal(by_kernel.pattern.row, by_hand.pattern.row)
    np.testing.assert_allclose(hand_cost, cost)
    np.testing.assert_allclose(hand_g, g, atol=1e-6)
    np.testing.assert_allclose(hand_values, values, atol=1e-6)


def test_blocks_between_three_variables():
    rng = np.random.default_rng(3)
    variables = Variables(np.array([POINT2, POSE2, POINT3, POINT2, POSE2, POINT3]), np.zeros(6, bool))
    index = np.array([[1, 0, 2], [4, 3, 5], [1, 3, 5]])
    problem = Problem(variables.kinds)
    handle = problem.add_blocks(index, 4)
    e, J = rng.normal(size=(3, 4)), rng.normal(size=(3, 4, 8))
    _, g, values = problem.linearise(variables.random_state(rng), {handle: (e, J, 0.0)})
    H, expected_g = np.zeros((16, 16)), np.zeros(16)
    for row, e_row, J_row in zip(index, e, J, strict=True):
        add_row(variables, row, J_row, e_row, J_row, H, expected_g)
    np.testing.assert_allclose(g, expected_g)
    np.testing.assert_allclose(dense(problem.pattern, values), H, atol=1e-14)


def large_problem(rng, poses=6000, points=300, sightings=40000):
    """Large enough for many chunks, in no good order, with many seams."""
    kinds = np.concatenate([np.full(poses, POSE3), np.full(points, POINT3)])
    order = rng.permutation(poses + points)
    place = np.argsort(order)
    variables = Variables(kinds[order], np.arange(poses + points) == place[0])
    problem = Problem(variables.kinds, variables.fixed)
    odometry = place[np.stack([np.arange(poses - 1), np.arange(1, poses)], 1)]
    z = np.tile(np.concatenate([[1.0, 0, 0], np.eye(3).ravel()]), (poses - 1, 1))
    problem.add_table("relative_pose", 3, odometry, z, np.eye(6)[None])
    pairs = place[np.stack([rng.integers(0, poses, sightings), poses + rng.integers(0, points, sightings)], 1)]
    handle = problem.add_table("point", 3, pairs, rng.normal(size=(sightings, 3)), np.eye(3)[None], loss="cauchy")
    state = np.empty(variables.offsets[-1])
    for v, kind in enumerate(variables.kinds):
        start, end = variables.offsets[v : v + 2]
        state[start:end] = (
            np.concatenate([rng.normal(size=3), np.eye(3).ravel()]) if kind == POSE3 else rng.normal(size=3)
        )
    return problem, variables, handle, pairs, state


def test_one_thread_and_many_give_the_same_bits():
    problem, _, handle, _, state = large_problem(np.random.default_rng(4))
    delta = np.random.default_rng(5).normal(0, 0.3, problem.pattern.scalars)
    state = problem.retract(state, delta)
    before = kernel.threads()
    found = []
    try:
        for threads in (1, 2, 3, 2):
            kernel.set_threads(threads)
            cost, g, values = problem.linearise(state)
            found.append((cost, g, values, problem.cost(state), problem.residuals(state, handle)))
    finally:
        kernel.set_threads(before)
    for other in found[1:]:
        for a, b in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_many_chunks_add_up():
    # Column sums of H over the sightings of one landmark, against the rows: what crosses chunks is not lost.
    problem, variables, handle, pairs, state = large_problem(np.random.default_rng(6))
    _, g, values = problem.linearise(state)
    e = problem.residuals(state, handle)
    squared = np.sum(e**2, 1)
    weight = 1 / (1 + squared)
    pattern = problem.pattern
    free = np.cumsum(~variables.fixed) - 1
    for landmark in np.unique(pairs[:, 1])[:50]:
        mine = pairs[:, 1] == landmark
        column = free[landmark]
        block = pattern.column_start[column]
        start = pattern.value_start[block]
        # R = I at this state, so a sighting adds its weight times the identity, and the weighted residual to g.
        np.testing.assert_allclose(
            values[start : start + 9].reshape(3, 3), weight[mine].sum() * np.eye(3), rtol=1e-10, atol=1e-12
        )
        scalar = pattern.scalar_start[column]
        np.testing.assert_allclose(g[scalar : scalar + 3], weight[mine] @ e[mine], atol=1e-9)


def test_a_diagonal_block_is_symmetric_to_the_bit():
    problem, _, _, _, state = large_problem(np.random.default_rng(7), poses=50, points=5, sightings=200)
    state = problem.retract(state, np.random.default_rng(8).normal(0, 0.3, problem.pattern.scalars))
    _, _, values = problem.linearise(state)
    H = dense(problem.pattern, values)
    np.testing.assert_array_equal(H, H.T)


def test_a_problem_of_held_variables_has_a_cost_and_no_unknowns():
    problem = Problem([POSE2, POINT2], np.array([True, True]))
    problem.add_table("point", 2, [[0, 1]], [[1.0, 2.0]], np.eye(2)[None])
    state = np.array([0, 0, 1, 0, 0, 1, 0, 0.0])
    cost, g, values = problem.linearise(state)
    assert cost == pytest.approx(5.0)
    assert g.shape == values.shape == (0,)
    np.testing.assert_array_equal(problem.retract(state, np.zeros(0)), state)
