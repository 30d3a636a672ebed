"""A planar log of one robot in GTSAM, from any start: its optimum under the residuals of eqs. (3) and (4)."""

from typing import Any

import gtsam
import numpy as np

from teamslam.geometry import Pose
from teamslam.model import Dataset, Kind, Table, Values


def optimum(dataset: Dataset, start: Values, method: str, *, exact: bool) -> tuple[Values, int]:
    """What GTSAM's `method` ends at, and its iterations.

    `exact`: sightings as custom factors with the log's own residual; else as bearing and range, which are compiled.
    """
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    poses, points = start.of_kind(Kind.POSE2), start.of_kind(Kind.POINT2)
    assert isinstance(poses, Pose)
    pose_keys, point_keys = start.layout.keys_of(Kind.POSE2), start.layout.keys_of(Kind.POINT2)
    for key, xytheta in zip(pose_keys.tolist(), poses.xytheta(), strict=True):
        initial.insert(key, gtsam.Pose2(*xytheta))
    for key, point in zip(point_keys.tolist(), points, strict=True):
        initial.insert(key, point)
    for table in dataset.tables:
        add_steps(graph, table) if table.model == "relative_pose" else add_sightings(graph, table, exact)
    first = int(pose_keys[0])
    graph.push_back(gtsam.NonlinearEqualityPose2(first, initial.atPose2(first)))
    params = getattr(gtsam, f"{method}Params")()
    params.setMaxIterations(100)
    params.setOrderingType("METIS")
    params.setRelativeErrorTol(1e-12 if exact else 1e-8)
    params.setAbsoluteErrorTol(0.0)
    optimiser = getattr(gtsam, f"{method}Optimizer")(graph, initial, params)
    found = optimiser.optimize()
    there = np.array([(p.x(), p.y(), p.theta()) for p in map(found.atPose2, pose_keys.tolist())])
    marks = np.array([found.atPoint2(key) for key in point_keys.tolist()])
    values = Values.of({Kind.POSE2: (pose_keys, Pose.from_xytheta(there)), Kind.POINT2: (point_keys, marks)})
    return values, optimiser.iterations()


def add_steps(graph: Any, table: Table) -> None:
    """Odometry. GTSAM writes the residual in the frame of the measured end, so the noise is turned along."""
    for row, keys in enumerate(table.keys.tolist()):
        R = table.values[row, 2:].reshape(2, 2)
        W = table.whitening[min(row, len(table.whitening) - 1)].copy()
        W[:, :2] = W[:, :2] @ R
        step = gtsam.Pose2(*table.values[row, :2], np.arctan2(R[1, 0], R[0, 0]))
        graph.push_back(gtsam.BetweenFactorPose2(*keys, step, gtsam.noiseModel.Gaussian.Information(W.T @ W)))


def add_sightings(graph: Any, table: Table, exact: bool) -> None:
    """Points seen from poses."""
    for row, keys in enumerate(table.keys.tolist()):
        W, z = table.whitening[min(row, len(table.whitening) - 1)], table.values[row]
        if exact:
            graph.push_back(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(2), keys, residual_of(W, z)))
            continue
        r2 = float(z @ z)
        r = np.sqrt(r2)
        to_point = np.array([[-z[1], z[0] / r], [z[0], z[1] / r]])  # d z / d (bearing, range)
        noise = gtsam.noiseModel.Gaussian.Information(to_point.T @ (W.T @ W) @ to_point)
        graph.push_back(gtsam.BearingRangeFactor2D(*keys, gtsam.Rot2(np.arctan2(z[1], z[0])), r, noise))


def residual_of(W: np.ndarray, z: np.ndarray) -> Any:
    """h - z, whitened: GTSAM's sign, with Jacobians in GTSAM's chart (translation in the body)."""

    def evaluate(this: Any, values: Any, jacobians: list[np.ndarray] | None) -> np.ndarray:
        pose_key, point_key = this.keys()
        pose, point = values.atPose2(pose_key), values.atPoint2(point_key)
        back = pose.rotation().matrix().T
        h = back @ (point - pose.translation())
        if jacobians is not None:
            jacobians[0] = W @ np.array([[-1.0, 0.0, h[1]], [0.0, -1.0, -h[0]]])
            jacobians[1] = W @ back
        return W @ (h - z)

    return evaluate
