"""GTSAM from Python, as who knows it sets it up: elimination by METIS, whose factor is the smaller one on long ways
that meet, and Levenberg-Marquardt to a relative change of 1e-8 in at most 100 iterations, since its defaults (COLAMD,
1e-5) end early. Sightings go in as bearing and range, which its wheel has compiled.
"""

from typing import Any

import gtsam
import numpy as np

from by_hand import Log, Map, Stages


def solve(solver: str, log: Log, start: Map, stages: Stages) -> Map:
    """The team's optimum from a start."""
    graph, initial = stages("build", lambda: problem(log, start))
    found = stages("solve", lambda: gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters()).optimize())
    return stages("read back", lambda: map_of(found, start))


def parameters() -> Any:
    found = gtsam.LevenbergMarquardtParams()
    found.setOrderingType("METIS")
    found.setRelativeErrorTol(1e-8)
    found.setAbsoluteErrorTol(0.0)
    found.setMaxIterations(100)
    return found


def problem(log: Log, start: Map) -> tuple[Any, Any]:
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for r, way in start.poses.items():
        for k, pose in enumerate(way.tolist()):
            initial.insert(key(r, k), gtsam.Pose2(*pose))
    for name, place in start.marks.items():
        initial.insert(name, place)
    first = key(log.robots[0], 0)
    graph.push_back(gtsam.NonlinearEqualityPose2(first, initial.atPose2(first)))
    steps, seen = (gtsam.noiseModel.Gaussian.Covariance(log.noise[what]) for what in ("odometry", "robots"))
    for r, table in log.tables["odometry"].items():
        for k, z in enumerate(table[["x", "y", "theta"]].to_numpy().tolist()):
            graph.push_back(gtsam.BetweenFactorPose2(key(r, k), key(r, k + 1), gtsam.Pose2(*z), steps))
    for r, table in log.tables["robots"].items():
        for row in table.itertuples():
            z = gtsam.Pose2(row.x, row.y, row.theta)
            graph.push_back(
                gtsam.BetweenFactorPose2(key(r, round(row.stamp)), key(int(row.other), round(row.other_stamp)), z, seen)
            )
    sigma = float(np.sqrt(log.noise["landmarks"][0, 0]))
    for r, table in log.tables["landmarks"].items():
        xy = table[["x", "y"]].to_numpy()
        ranges, bearings = np.hypot(*xy.T), np.arctan2(xy[:, 1], xy[:, 0])
        observers, names = table["stamp"].round().astype(int).tolist(), table["landmark"].astype(int).tolist()
        for k, name, distance, bearing in zip(observers, names, ranges.tolist(), bearings.tolist(), strict=True):
            sd = gtsam.noiseModel.Diagonal.Sigmas(np.array([sigma / distance, sigma]))
            graph.push_back(gtsam.BearingRangeFactor2D(key(r, k), name, gtsam.Rot2(bearing), distance, sd))
    return graph, initial


def key(robot: int, k: int) -> int:
    return robot * 10_000_000 + k


def map_of(found: Any, start: Map) -> Map:
    poses = {}
    for r, way in start.poses.items():
        at = [found.atPose2(key(r, k)) for k in range(len(way))]
        poses[r] = np.array([(p.x(), p.y(), p.theta()) for p in at])
    return Map(poses, {name: found.atPoint2(name) for name in start.marks})
