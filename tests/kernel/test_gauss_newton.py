"""Problem and factor together: Gauss-Newton comes home."""

import numpy as np
import pytest

from kernel.formulas import POINT2, POINT3, POSE2, POSE3, Variables, lift, residual
from teamslam.kernel import Factor, Problem


def solve(problem, state, steps=30):
    factor = Factor(problem.pattern)
    for _ in range(steps):
        _, g, values = problem.linearise(state)
        factor.factor(values)
        delta = factor.solve(g)
        state = problem.retract(state, delta)
        if np.abs(delta).max() < 1e-12:
            break
    return state, factor


def world(rng, pose_kind, point_kind, poses=12, points=8):
    """A ring of poses about some points, exact measurements, and a start that is off."""
    kinds = np.array([pose_kind] * poses + [point_kind] * points)
    angles = np.linspace(0, 2 * np.pi, poses, endpoint=False)
    ring = [np.array([4 * np.cos(a), 4 * np.sin(a), -np.sin(a), -np.cos(a), np.cos(a), -np.sin(a)]) for a in angles]
    truth = [lift(x) if pose_kind == POSE3 else x for x in ring]
    truth += list(rng.normal(0, 1, (points, 3 if point_kind == POINT3 else 2)))
    return Variables(kinds, np.arange(poses + points) == 0), np.concatenate(truth)


@pytest.mark.parametrize(
    ("dim", "pose_kind", "point_kind"), [(2, POSE2, POINT2), (3, POSE2, POINT3), (3, POSE3, POINT3)]
)
@pytest.mark.parametrize("sighting", ["point", "range_bearing"])
def test_exact_measurements_lead_to_the_truth(dim, pose_kind, point_kind, sighting):
    rng = np.random.default_rng(1)
    variables, truth = world(rng, pose_kind, point_kind)
    poses = int((variables.kinds == pose_kind).sum())
    problem = Problem(variables.kinds, variables.fixed)

    def exact(model, index):
        """What a perfect sensor reads: the z that makes the residual zero."""
        out = []
        for row in index:
            first, second = variables.of(truth, row[0]), variables.of(truth, row[1])
            if dim == 3:
                first = lift(first)
            T, R = first[:dim], first[dim:].reshape(dim, dim)
            h = R.T @ (second[:dim] - T) if len(second) >= dim and model != "relative_pose" else None
            if model == "relative_pose":
                other = lift(second) if dim == 3 else second
                S = other[dim:].reshape(dim, dim)
                out.append(np.concatenate([R.T @ (other[:dim] - T), (R.T @ S).ravel()]))
            elif model == "point":
                out.append(h)
            else:
                r = np.linalg.norm(h)
                out.append(np.concatenate([[r], [np.arctan2(h[1], h[0])] if dim == 2 else h / r]))
        return np.array(out)

    odometry = np.stack([np.arange(poses - 1), np.arange(1, poses)], 1)
    seen = np.array([(i, j) for i in range(poses) for j in range(poses, len(variables.kinds)) if (i + j) % 2])
    n = 3 * dim - 3
    problem.add_table("relative_pose", dim, odometry, exact("relative_pose", odometry), np.eye(n)[None])
    problem.add_table(sighting, dim, seen, exact(sighting, seen), 10 * np.eye(dim)[None])
    start = problem.retract(truth, rng.normal(0, 0.1, problem.pattern.scalars))
    assert problem.cost(start) > 1.0
    estimate, _ = solve(problem, start)
    np.testing.assert_allclose(estimate, truth, atol=1e-9)
    assert problem.cost(estimate) < 1e-20


def test_marginals_of_a_chain_of_positions_are_known():
    # x0 held, x_i - x_{i-1} known to 1: the variance of x_i is i.
    n = 30
    problem = Problem([POSE2] * n, np.arange(n) == 0)
    step = np.tile([1.0, 0, 1, 0, 0, 1], (n - 1, 1))
    index = np.stack([np.arange(n - 1), np.arange(1, n)], 1)
    problem.add_table("relative_pose", 2, index, step, np.diag([1.0, 1.0, 1e6])[None])
    state = np.concatenate([[i, 0.0, 1, 0, 0, 1] for i in range(n)])
    _, factor = solve(problem, state, steps=1)
    for i, block in enumerate(factor.diagonal_inverse(), start=1):
        np.testing.assert_allclose(np.diag(block)[:2], [i, i], rtol=1e-6)


def test_a_robust_loss_shrugs_off_an_outlier():
    z = np.array([[1.0, 2], [1.1, 2], [0.9, 2], [1.0, 2.1], [50.0, -40]])
    problem = Problem([POINT2])
    problem.add_table("position", 2, np.zeros((5, 1), int), z, 10 * np.eye(2)[None], loss="geman_mcclure", scale=3.0)
    estimate, _ = solve(problem, np.array([1.2, 1.8]), steps=100)
    assert np.abs(estimate - [1.0, 2.025]).max() < 0.01


def test_residual_oracle_is_zero_on_exact_measurements():
    rng = np.random.default_rng(2)
    here, p = Variables(np.array([POSE3]), np.zeros(1, bool)).random_state(rng), rng.normal(size=3)
    z = here[3:].reshape(3, 3).T @ (p - here[:3])
    np.testing.assert_allclose(residual("point", 3, z, None, [here, p]), 0, atol=1e-14)
