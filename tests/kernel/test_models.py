"""Every measurement model between every pair of kinds: the residual is its definition, the Jacobian its derivative."""

import itertools

import numpy as np
import pytest

from kernel.formulas import (
    DOFS,
    KIND_NAMES,
    POINT2,
    POINT3,
    POSE2,
    POSE3,
    combinations,
    dense,
    exp,
    jacobian,
    lift,
    measurement,
    pose_numbers,
    random_variable,
    residual,
)
from teamslam.errors import ModelError
from teamslam.kernel import MODELS, Problem


def named(case):
    model, dim, kinds = case
    return f"{model}-{dim}d-{'-'.join(KIND_NAMES[k] for k in kinds)}"


CASES = [
    pytest.param(case, sensed, id=named(case) + ("-sensor" if sensed else ""))
    for case in combinations()
    for sensed in (False, True)
    if not (sensed and case[2][0] in (POINT2, POINT3))
]


def rows_of(case, sensed, rng, count=4):
    """One random row after another: z, sensor, variables."""
    model, dim, kinds = case
    sensor = pose_numbers(rng, dim) if sensed else None
    for _ in range(count):
        yield measurement(rng, model, dim), sensor, [random_variable(rng, kind) for kind in kinds]


def problem_of(case, z, sensor, whitening, fixed=None):
    model, dim, kinds = case
    problem = Problem(kinds, np.zeros(len(kinds), bool) if fixed is None else fixed)
    handle = problem.add_table(model, dim, [list(range(len(kinds)))], z[None], whitening[None], sensor=sensor)
    return problem, handle


@pytest.mark.parametrize(("case", "sensed"), CASES)
def test_residual_is_its_definition(case, sensed):
    rng = np.random.default_rng(1)
    for z, sensor, variables in rows_of(case, sensed, rng):
        expected = residual(case[0], case[1], z, sensor, variables)
        whitening = rng.normal(size=(len(expected), len(expected)))
        problem, handle = problem_of(case, z, sensor, whitening)
        state = np.concatenate(variables)
        np.testing.assert_allclose(problem.residuals(state, handle)[0], whitening @ expected, atol=1e-12)
        np.testing.assert_allclose(problem.cost(state), np.sum((whitening @ expected) ** 2), rtol=1e-12)


@pytest.mark.parametrize(("case", "sensed"), CASES)
def test_jacobian_is_the_derivative_of_the_residual(case, sensed):
    # A whitening that keeps one row of e shows that row's J: g = J_i e_i and H = J_i'J_i.
    rng = np.random.default_rng(2)
    for z, sensor, variables in rows_of(case, sensed, rng):
        model, dim, kinds = case
        e = residual(model, dim, z, sensor, variables)
        J = jacobian(model, dim, z, sensor, kinds, variables)
        assert np.isfinite(J).all()
        for i in range(len(e)):
            problem, _ = problem_of(case, z, sensor, np.diag(np.arange(len(e)) == i).astype(float))
            _, gradient, values = problem.linearise(np.concatenate(variables))
            scale = 1 + np.abs(J[i]).max() ** 2
            np.testing.assert_allclose(gradient, J[i] * e[i], atol=1e-8 * scale)
            np.testing.assert_allclose(dense(problem.pattern, values), np.outer(J[i], J[i]), atol=1e-8 * scale)


@pytest.mark.parametrize("case", combinations(), ids=named)
def test_held_variables_are_absent_and_change_nothing_else(case):
    rng = np.random.default_rng(3)
    z, _, variables = next(rows_of(case, False, rng))
    r = len(residual(case[0], case[1], z, None, variables))
    whitening = rng.normal(size=(r, r))
    state = np.concatenate(variables)
    whole, _ = problem_of(case, z, None, whitening)
    cost, g, values = whole.linearise(state)
    H = dense(whole.pattern, values)
    dofs = np.repeat(np.arange(len(case[2])), [DOFS[k] for k in case[2]])
    for fixed in itertools.product([False, True], repeat=len(case[2])):
        problem, _ = problem_of(case, z, None, whitening, np.array(fixed))
        part_cost, part_g, part_values = problem.linearise(state)
        free = ~np.array(fixed)[dofs]
        assert part_cost == cost
        np.testing.assert_array_equal(part_g, g[free])
        np.testing.assert_array_equal(dense(problem.pattern, part_values), H[np.ix_(free, free)])


def test_whatever_is_not_related_is_refused():
    known = set(combinations())
    rng = np.random.default_rng(4)
    for model, dim in itertools.product(MODELS, (2, 3)):
        z = measurement(rng, model, dim)
        for kinds in itertools.product(range(4), repeat=1 if model in ("position", "pose") else 2):
            if (model, dim, kinds) in known:
                continue
            r = len(z) if model != "bearing" else dim - 1
            r = {"relative_pose": DOFS[dim - 2], "pose": DOFS[dim - 2], "range_bearing": dim, "corners": 8}.get(
                model, r
            )
            with pytest.raises(ModelError, match=f"cannot relate {KIND_NAMES[kinds[0]]}"):
                problem_of((model, dim, kinds), z, None, np.eye(r))


# --- the hard places ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 1e-3, 0.1, 3.0, np.pi - 1e-3, np.pi - 1e-6, np.pi])
def test_relative_pose_at_any_angle(angle):
    # Log(exp(w)) = w for angles up to pi, where the sign of the axis is free.
    rng = np.random.default_rng(5)
    case = ("relative_pose", 3, (POSE3, POSE3))
    for _ in range(5):
        axis = rng.normal(size=3)
        w = angle * axis / np.linalg.norm(axis)
        here = pose_numbers(rng, 3)
        z = np.concatenate([np.zeros(3), exp(w).ravel()])
        problem, handle = problem_of(case, z, None, np.eye(6))
        found = problem.residuals(np.concatenate([here, here]), handle)[0, 3:]
        if angle == np.pi:
            np.testing.assert_allclose(np.linalg.norm(found), np.pi, atol=1e-12)
            found *= np.sign(found @ w)
        np.testing.assert_allclose(found, w, atol=1e-9 if angle > 3.1 else 1e-14)


@pytest.mark.parametrize("angle", [1e-9, 1e-6, 1e-4, 2e-3, 4e-3, 0.19, 0.21, 1.0, 3.0, 3.1])
def test_relative_pose_jacobian_at_any_angle(angle):
    rng = np.random.default_rng(6)
    axis = rng.normal(size=3)
    here, there = pose_numbers(rng, 3), pose_numbers(rng, 3)
    R = here[3:].reshape(3, 3).T @ there[3:].reshape(3, 3) @ exp(angle * axis / np.linalg.norm(axis))
    z = np.concatenate([rng.normal(size=3), R.ravel()])
    case = ("relative_pose", 3, (POSE3, POSE3))
    J = jacobian("relative_pose", 3, z, None, case[2], [here, there])
    problem, _ = problem_of(case, z, None, np.eye(6))
    _, _, values = problem.linearise(np.concatenate([here, there]))
    np.testing.assert_allclose(dense(problem.pattern, values), J.T @ J, atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-3, 3e-3, 3.3e-3, 0.1, 1.5, 1.7, 3.0, 3.14])
def test_direction_in_space_at_any_angle(angle):
    # The residual is as long as the angle between the directions, and J'J as the map of the sphere says.
    rng = np.random.default_rng(7)
    for _ in range(5):
        z = rng.normal(size=3)
        z /= np.linalg.norm(z)
        side = np.cross(z, rng.normal(size=3))
        side /= np.linalg.norm(side)
        u = np.cos(angle) * z + np.sin(angle) * side
        here = pose_numbers(rng, 3)
        distance = rng.uniform(1, 5)
        target = here[:3] + here[3:].reshape(3, 3) @ (distance * u)
        case = ("bearing", 3, (POSE3, POINT3))
        problem, handle = problem_of(case, z, None, np.eye(2), fixed=np.array([True, False]))
        state = np.concatenate([here, target])
        np.testing.assert_allclose(np.linalg.norm(problem.residuals(state, handle)), angle, atol=1e-12)
        _, _, values = problem.linearise(state)
        H = dense(problem.pattern, values) * distance**2
        turned = here[3:].reshape(3, 3)
        across = np.cross(z, side)
        # Towards z the residual changes one for one; across, by angle / sin(angle).
        grow = angle / np.sin(angle) if angle > 0 else 1.0
        along = np.cross(across, u)
        expected = np.outer(along, along) + grow**2 * np.outer(across, across)
        np.testing.assert_allclose(turned.T @ H @ turned, expected, atol=1e-7 * grow**2)


@pytest.mark.parametrize("model", ["range", "bearing", "range_bearing"])
@pytest.mark.parametrize("dim", [2, 3])
def test_target_at_the_sensor_lies_straight_ahead_and_says_nothing(model, dim):
    rng = np.random.default_rng(8)
    kinds = (POSE2, POINT2) if dim == 2 else (POSE3, POINT3)
    here = random_variable(rng, kinds[0])
    state = np.concatenate([here, here[:dim]])
    z = measurement(rng, model, dim)
    ahead = np.concatenate([here, here[:dim] + rotation_of(here)[:, 0]])
    r = len(residual(model, dim, z, None, [here, ahead[-dim:]]))
    problem, handle = problem_of((model, dim, kinds), z, None, np.eye(r))
    found = problem.residuals(state, handle)[0]
    expected = problem.residuals(ahead, handle)[0] + (np.eye(r)[0] if model != "bearing" else 0.0)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    _, gradient, values = problem.linearise(state)
    assert not gradient.any() and not values.any()


@pytest.mark.parametrize("model", ["range", "bearing", "range_bearing"])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("distance", [1e-6, 1e-11, 1e-13, 1e-20, 1e-60])
def test_a_direction_is_one_however_near_it_is(model, dim, distance):
    """A bearing to the wrong side of its sensor is as wrong a hair's breadth from it as a metre away."""
    rng = np.random.default_rng(10)
    kinds = (POSE2, POINT2) if dim == 2 else (POSE3, POINT3)
    here = np.concatenate([np.zeros(dim), rotation_of(random_variable(rng, kinds[0])).ravel()])
    for _ in range(5):
        u = rng.normal(size=dim)
        u /= np.linalg.norm(u)
        z = measurement(rng, model, dim)
        case = (model, dim, kinds)
        r = len(residual(model, dim, z, None, [here, u]))
        problem, handle = problem_of(case, z, None, np.eye(r), fixed=np.array([True, False]))
        away = problem.residuals(np.concatenate([here, u]), handle)[0]
        near = problem.residuals(np.concatenate([here, distance * u]), handle)[0]
        if model != "bearing":
            away[0] += 1.0 - distance
        np.testing.assert_allclose(near, away, atol=1e-12)
        _, gradient, values = problem.linearise(np.concatenate([here, distance * u]))
        assert np.isfinite(gradient).all() and np.isfinite(values).all() and values.any()


def rotation_of(pose):
    d = 2 if len(pose) == 6 else 3
    return pose[d:].reshape(d, d)


def test_direction_opposite_to_the_measured_one():
    problem, handle = problem_of(("bearing", 3, (POSE3, POINT3)), np.array([0.0, 0.6, 0.8]), None, np.eye(2))
    state = np.concatenate([np.zeros(3), np.eye(3).ravel(), [0.0, -0.6, -0.8]])
    np.testing.assert_allclose(np.linalg.norm(problem.residuals(state, handle)), np.pi)
    cost, gradient, values = problem.linearise(state)
    assert np.isfinite(cost) and np.isfinite(gradient).all() and np.isfinite(values).all()


def test_angles_are_taken_round_the_circle():
    rng = np.random.default_rng(9)
    here, there = random_variable(rng, POSE2), rng.normal(size=2)
    state = np.concatenate([here, there])
    found = []
    for turns in (-3, 0, 2):
        z = np.array([0.3 + 2 * np.pi * turns])
        problem, handle = problem_of(("bearing", 2, (POSE2, POINT2)), z, None, np.eye(1))
        found.append(problem.residuals(state, handle)[0, 0])
    np.testing.assert_allclose(found, found[1], atol=1e-12)
    assert abs(found[1]) <= np.pi


def test_planar_problems_in_space_agree_with_the_plane():
    # A planar robot that sees a point at its own height: the plane's cost, and a row for the height that is zero.
    rng = np.random.default_rng(10)
    here, p = random_variable(rng, POSE2), rng.normal(size=2)
    z = rng.normal(size=2)
    flat, _ = problem_of(("point", 2, (POSE2, POINT2)), z, None, np.eye(2))
    space, _ = problem_of(("point", 3, (POSE2, POINT3)), np.append(z, 0.0), None, np.eye(3))
    np.testing.assert_allclose(
        flat.cost(np.concatenate([here, p])), space.cost(np.concatenate([here, p, [0.0]])), rtol=1e-13
    )


def test_pose3_and_pose2_in_the_plane_give_the_same_relative_pose():
    rng = np.random.default_rng(12)
    a, b, z = (random_variable(rng, POSE2) for _ in range(3))
    costs = []
    for kinds in itertools.product((POSE2, POSE3), repeat=2):
        state = np.concatenate([x if k == POSE2 else lift(x) for k, x in zip(kinds, (a, b), strict=True)])
        problem, _ = problem_of(("relative_pose", 3, kinds), lift(z), None, np.eye(6))
        costs.append(problem.cost(state))
    flat, _ = problem_of(("relative_pose", 2, (POSE2, POSE2)), z, None, np.eye(3))
    np.testing.assert_allclose(costs, flat.cost(np.concatenate([a, b])), rtol=1e-12)
