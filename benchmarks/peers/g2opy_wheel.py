"""g2o from PyPI (g2opy): Gauss-Newton with Eigen's Cholesky and AMD, which is what the wheel offers.

It cannot return marginals.
"""

from dataclasses import dataclass
from importlib.metadata import version as of
from typing import Any

import g2opy
import numpy as np

from problems import SIGMA_P, SIGMA_R, SIGMA_T, Estimate, Problem


@dataclass
class Model:
    """The problem as g2o sees it: poses are numbered from 0, landmarks after them."""

    problem: Problem
    graph: Any
    poses: list[Any]
    points: list[Any]


def version() -> str:
    return of("g2opy")


def warm(problem: Problem) -> None:
    """Nothing to prepare."""


def build(problem: Problem, variant: str) -> Model:
    planar = problem.dim == 2
    graph = g2opy.SparseOptimizer()
    linear = g2opy.LinearSolverEigenX()
    graph.set_algorithm(g2opy.OptimizationAlgorithmGaussNewton(g2opy.BlockSolverX(linear)))
    enough = g2opy.SparseOptimizerTerminateAction()
    enough.set_gain_threshold(1e-8)
    graph.add_post_iteration_action(enough)
    if not planar:
        offset = g2opy.ParameterSE3Offset()
        offset.set_id(0)
        graph.add_parameter(offset)
    poses, points = [], []
    for k, pose in enumerate(_poses(problem.start_T, problem.start_R)):
        vertex = g2opy.VertexSE2() if planar else g2opy.VertexSE3()
        vertex.set_id(k)
        vertex.set_estimate(pose)
        vertex.set_fixed(k == 0)
        graph.add_vertex(vertex)
        poses.append(vertex)
    for k, point in enumerate(problem.start_P, len(poses)):
        vertex = g2opy.VertexPointXY() if planar else g2opy.VertexPointXYZ()
        vertex.set_id(k)
        vertex.set_estimate(point)
        graph.add_vertex(vertex)
        points.append(vertex)
    # In space g2o's rotation error is the vector part of a quaternion: half the angle, near zero.
    turn = [SIGMA_R**-2] if planar else [4.0 * SIGMA_R**-2] * 3
    of_steps = np.diag([SIGMA_T**-2] * problem.dim + turn)
    for k, step in zip(problem.odometry_from.tolist(), _poses(problem.odometry_T, problem.odometry_R), strict=True):
        edge = g2opy.EdgeSE2() if planar else g2opy.EdgeSE3()
        edge.set_vertex(0, poses[k])
        edge.set_vertex(1, poses[k + 1])
        edge.set_measurement(step)
        edge.set_information(of_steps)
        graph.add_edge(edge)
    of_points = np.eye(problem.dim) * SIGMA_P**-2
    for observer, mark, z in zip(problem.seen_from.tolist(), problem.seen.tolist(), problem.sightings, strict=True):
        edge = g2opy.EdgeSE2PointXY() if planar else g2opy.EdgeSE3PointXYZ()
        edge.set_vertex(0, poses[observer])
        edge.set_vertex(1, points[mark])
        edge.set_measurement(z)
        edge.set_information(of_points)
        if not planar:
            edge.set_parameter_id(0, 0)
        graph.add_edge(edge)
    return Model(problem, graph, poses, points)


def solve(model: Model) -> tuple[Model, int]:
    model.graph.initialize_optimization()
    return model, model.graph.optimize(50)


def read(model: Model) -> Estimate:
    if model.problem.dim == 2:
        flat = np.array([v.estimate().to_vector() for v in model.poses])
        c, s = np.cos(flat[:, 2]), np.sin(flat[:, 2])
        R = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)
        T = flat[:, :2]
    else:
        estimates = [v.estimate() for v in model.poses]
        matrices = np.array([x.matrix() for x in estimates])
        R, T = matrices[:, :3, :3], matrices[:, :3, 3]
    return Estimate(T, R, np.array([v.estimate() for v in model.points]))


def _poses(T: np.ndarray, R: np.ndarray) -> list[Any]:
    if T.shape[1] == 2:
        return [g2opy.SE2(*x) for x in np.column_stack([T, np.arctan2(R[:, 1, 0], R[:, 0, 0])]).tolist()]
    matrices = np.tile(np.eye(4), (len(T), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = R, T
    return [g2opy.Isometry3d(m) for m in matrices]
