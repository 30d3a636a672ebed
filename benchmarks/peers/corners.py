"""Corners of tags by teamslam, and by Ceres and GTSAM from their wheels: each from a problem to poses.

teamslam has corners as a model of its own. The wheels have none, and take a cost function in Python with its
derivatives: four directions on the tangent plane of what was seen, which is the angle to third order. A pose moves by
T + dT, R Exp(w) in Ceres (a block of a quaternion), by T + R v, R Exp(w) in GTSAM.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from corner_problem import SIGMA, Poses, Problem

from . import residuals

Found = tuple[Poses, Poses, int, float, float]  # frames, tags, steps, seconds to build and to solve
MOST, SHARE = 50, 1e-8  # steps; of the cost that a step gains at the end


def teamslam(of: Problem) -> Found:
    """Through its Python interface."""
    from teamslam.geometry import Pose
    from teamslam.model import Kind, Table, Values, landmark_key, pose_key
    from teamslam.solver import Options, System, optimise

    began = time.perf_counter()
    n, m = len(of.frames.T), len(of.tags.T)
    poses, marks = pose_key(1, np.arange(n)), landmark_key(np.arange(m))
    values = np.concatenate([of.rays.reshape(-1, 12), np.tile(of.places.ravel(), (len(of.rays), 1))], 1)
    keys = np.stack([poses[of.frame], marks[of.tag]], -1)
    table = Table(1, "camera", "corners", 3, keys, values, np.eye(8)[None] / SIGMA, np.arange(len(keys)))
    both = Pose(np.concatenate([of.frames.R, of.tags.R]), np.concatenate([of.frames.T, of.tags.T]))
    start = Values.of({Kind.POSE3: (np.concatenate([poses, marks]), both)})
    system = System(start.layout, tables=[table], fixed=marks[:1])
    built = time.perf_counter()
    solution = optimise(system, start, Options(cost_share=SHARE))
    solved = time.perf_counter()
    found = [solution.values.poses_of(k, 3) for k in (poses, marks)]
    frames, tags = (Poses(pose.translation, pose.rotation) for pose in found)
    return frames, tags, solution.iterations, built - began, solved - built


def pyceres(of: Problem) -> Found:
    """Gauss-Newton steps with sparse Cholesky; frames may be eliminated first (Ceres finds its own ordering)."""
    import pyceres as ceres

    class Seen(ceres.CostFunction):  # type: ignore[misc]
        def __init__(self, ray: np.ndarray) -> None:
            super().__init__()
            self.plane = _plane(ray)
            self.set_num_residuals(8)
            self.set_parameter_block_sizes([3, 4, 3, 4])

        def Evaluate(self, x: Any, e: np.ndarray, jacobians: Any) -> bool:
            R, Q = residuals.rotation(x[1]), residuals.rotation(x[3])
            e[:], by_seen, seen, there = _residual(self.plane, x[0], R, x[2], Q, of.places)
            if jacobians is not None:
                by_place = by_seen @ R.T
                blocks = (
                    -by_place, residuals.by_numbers(by_seen @ _hat(seen), x[1]),
                    by_place, residuals.by_numbers(by_place @ Q @ -_hat(there), x[3]),
                )  # fmt: skip
                for wanted, block in zip(jacobians, blocks, strict=True):
                    if wanted is not None and wanted.size:
                        wanted[:] = block.ravel()
            return True

    began = time.perf_counter()
    options = ceres.ProblemOptions()
    options.disable_all_safety_checks = True
    graph = ceres.Problem(options)
    blocks = [(list(p.T.copy()), list(residuals.turns(p.R))) for p in (of.frames, of.tags)]
    for places, turns in blocks:
        for place, turn in zip(places, turns, strict=True):
            graph.add_parameter_block(place, 3)
            graph.add_parameter_block(turn, 4)
            graph.set_manifold(turn, ceres.EigenQuaternionManifold())
    (T, q), (S, r) = blocks
    for a, b, ray in zip(of.frame.tolist(), of.tag.tolist(), of.rays, strict=True):
        graph.add_residual_block(Seen(ray), None, [T[a], q[a], S[b], r[b]])
    graph.set_parameter_block_constant(S[0])
    graph.set_parameter_block_constant(r[0])
    built = time.perf_counter()
    how = ceres.SolverOptions()
    how.linear_solver_type = ceres.LinearSolverType.SPARSE_SCHUR
    how.sparse_linear_algebra_library_type = ceres.SparseLinearAlgebraLibraryType.SUITE_SPARSE
    how.max_num_iterations, how.function_tolerance = MOST, SHARE
    how.gradient_tolerance = how.parameter_tolerance = 0.0
    how.logging_type = ceres.LoggingType.SILENT
    summary = ceres.SolverSummary()
    ceres.solve(how, graph, summary)
    solved = time.perf_counter()
    frames, tags = (Poses(np.array(p), Rotation.from_quat(np.array(turns)).as_matrix()) for p, turns in blocks)
    return frames, tags, summary.num_linear_solves, built - began, solved - built


def gtsam(of: Problem) -> Found:
    """Levenberg-Marquardt as it comes, custom factors."""
    import gtsam as g

    began = time.perf_counter()
    graph, values = g.NonlinearFactorGraph(), g.Values()
    n, noise = len(of.frames.T), g.noiseModel.Unit.Create(8)
    for k, (place, turn) in enumerate(
        zip(np.concatenate([of.frames.T, of.tags.T]), np.concatenate([of.frames.R, of.tags.R]), strict=True)
    ):
        values.insert(k, g.Pose3(g.Rot3(turn), place))
    graph.push_back(g.NonlinearEqualityPose3(n, values.atPose3(n)))
    for a, b, ray in zip(of.frame.tolist(), of.tag.tolist(), of.rays, strict=True):
        graph.push_back(g.CustomFactor(noise, [a, n + b], _factor(_plane(ray), of.places)))
    built = time.perf_counter()
    params = g.LevenbergMarquardtParams()
    params.setRelativeErrorTol(SHARE)
    params.setAbsoluteErrorTol(0.0)
    params.setMaxIterations(MOST)
    optimiser = g.LevenbergMarquardtOptimizer(graph, values, params)
    found = optimiser.optimize()
    solved = time.perf_counter()
    flat = g.utilities.extractPose3(found)
    R, T = flat[:, :9].reshape(-1, 3, 3), flat[:, 9:]
    return Poses(T[:n], R[:n]), Poses(T[n:], R[n:]), optimiser.iterations(), built - began, solved - built


SOLVERS: dict[str, tuple[str, Callable[[Problem], Found]]] = {
    "teamslam": ("teamslam", teamslam),
    "pyceres": ("pyceres", pyceres),
    "gtsam": ("gtsam", gtsam),
}
"""By name: what must be installed, and how it solves."""


def _factor(plane: np.ndarray, places: np.ndarray) -> Callable[[Any, Any, Any], np.ndarray]:
    def error(this: Any, values: Any, jacobians: Any) -> np.ndarray:
        first, second = (values.atPose3(key).matrix() for key in list(this.keys()))
        R, Q = first[:3, :3], second[:3, :3]
        e, by_seen, seen, there = _residual(plane, first[:3, 3], R, second[:3, 3], Q, places)
        if jacobians is not None:
            by_body = by_seen @ R.T @ Q
            jacobians[0] = np.concatenate([by_seen @ _hat(seen), -by_seen @ np.eye(3)], -1).reshape(8, 6)
            jacobians[1] = np.concatenate([by_body @ -_hat(there), by_body], -1).reshape(8, 6)
        return e

    return error


def _residual(
    plane: np.ndarray, T: np.ndarray, R: np.ndarray, S: np.ndarray, Q: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(8,) in sigmas, its derivatives by the corners in the camera (4, 2, 3), and the corners in camera and tag."""
    seen = (places @ Q.T + (S - T)) @ R
    away = np.sqrt(np.einsum("ij,ij->i", seen, seen))[:, None]
    ray = seen / away
    e = np.einsum("nij,nj->ni", plane, ray)
    by_seen = (plane - e[:, :, None] * ray[:, None, :]) / away[:, :, None]
    return e.ravel(), by_seen, seen, places


def _plane(rays: np.ndarray) -> np.ndarray:
    """Two axes across each ray, in sigmas: (4, 2, 3)."""
    aside = np.cross(rays, np.eye(3)[np.abs(rays).argmin(1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    return np.stack([aside, np.cross(rays, aside)], 1) / SIGMA


def _hat(v: np.ndarray) -> np.ndarray:
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out
