"""GTSAM from PyPI.

Its wheel has no factor for the position of a point seen from a pose, so sightings enter as bearing and range with the
same noise to first order: a slightly different cost, whose optimum is judged under the neutral one.
"""

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from problems import SIGMA_P, SIGMA_R, SIGMA_T, Estimate, Problem


@dataclass
class Model:
    """The problem as GTSAM sees it: poses are numbered from 0, landmarks after them."""

    problem: Problem
    graph: Any
    values: Any
    params: Any


def version() -> str:
    from importlib.metadata import version as of

    return of("gtsam")


def warm(problem: Problem) -> None:
    """Nothing to prepare."""


def build(problem: Problem, variant: str) -> Model:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    n = len(problem.robots)
    a = problem.odometry_from.tolist()
    steps = _poses(problem.odometry_T, problem.odometry_R)
    if problem.dim == 2:
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([SIGMA_T, SIGMA_T, SIGMA_R]))
        for k, step in zip(a, steps, strict=True):
            graph.push_back(gtsam.BetweenFactorPose2(k, k + 1, step, noise))
    else:
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([SIGMA_R] * 3 + [SIGMA_T] * 3))
        for k, step in zip(a, steps, strict=True):
            graph.push_back(gtsam.BetweenFactorPose3(k, k + 1, step, noise))
    ranges = np.linalg.norm(problem.sightings, axis=1)
    observers, marks = problem.seen_from.tolist(), (problem.seen + n).tolist()
    sigmas = np.full((len(ranges), problem.dim), SIGMA_P)
    sigmas[:, :-1] /= ranges[:, None]
    bearing_of, factor = (
        (gtsam.Rot2, gtsam.BearingRangeFactor2D) if problem.dim == 2 else (gtsam.Unit3, gtsam.BearingRangeFactor3D)
    )
    seen: list[Any] = (
        [bearing_of(t) for t in np.arctan2(problem.sightings[:, 1], problem.sightings[:, 0]).tolist()]
        if problem.dim == 2
        else [bearing_of(z) for z in problem.sightings]
    )
    for observer, mark, bearing, distance, sigma in zip(observers, marks, seen, ranges.tolist(), sigmas, strict=True):
        graph.push_back(factor(observer, mark, bearing, distance, gtsam.noiseModel.Diagonal.Sigmas(sigma)))
    for k, pose in enumerate(_poses(problem.start_T, problem.start_R)):
        values.insert(k, pose)
    for k, point in enumerate(problem.start_P, n):
        values.insert(k, point)
    equality = gtsam.NonlinearEqualityPose2 if problem.dim == 2 else gtsam.NonlinearEqualityPose3
    first = values.atPose2(0) if problem.dim == 2 else values.atPose3(0)
    graph.push_back(equality(0, first))
    params = gtsam.GaussNewtonParams()
    params.setOrderingType("METIS" if variant == "metis" else "COLAMD")
    params.setRelativeErrorTol(1e-8)
    params.setAbsoluteErrorTol(0.0)
    params.setMaxIterations(50)
    return Model(problem, graph, values, params)


def solve(model: Model) -> tuple[Model, int]:
    optimiser = gtsam.GaussNewtonOptimizer(model.graph, model.values, model.params)
    model.values = optimiser.optimize()
    return model, optimiser.iterations()


def read(model: Model) -> Estimate:
    values, n = model.values, len(model.problem.robots)
    if model.problem.dim == 2:
        flat = gtsam.utilities.extractPose2(values)
        c, s = np.cos(flat[:, 2]), np.sin(flat[:, 2])
        R = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
        T = flat[:, :2]
    else:
        flat = gtsam.utilities.extractPose3(values)
        R, T = flat[:, :9].reshape(-1, 3, 3), flat[:, 9:]
    points = np.stack([values.atPoint2(n + k) if model.problem.dim == 2 else values.atPoint3(n + k)
                       for k in range(len(model.problem.start_P))])  # fmt: skip
    return Estimate(T, R, points)


def marginals(model: Model) -> float:
    found = gtsam.Marginals(model.graph, model.values)
    n = len(model.problem.robots)
    return float(sum(np.trace(found.marginalCovariance(n + k)) for k in range(len(model.problem.start_P))))


def _poses(T: np.ndarray, R: np.ndarray) -> list[Any]:
    if T.shape[1] == 2:
        headings = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        return [gtsam.Pose2(x, y, h) for x, y, h in np.column_stack([T, headings]).tolist()]
    return [gtsam.Pose3(gtsam.Rot3(r), t) for r, t in zip(R, T, strict=True)]
