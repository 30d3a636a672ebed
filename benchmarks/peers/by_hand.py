"""What people do by hand: pandas for the files, dead reckoning by numpy, GTSAM for the optimum. In the plane.

GTSAM as who knows it sets it up: elimination by METIS, whose factor is the smaller one on long ways that meet, and
Levenberg-Marquardt to a relative change of 1e-8 in at most 100 iterations, since its defaults (COLAMD, 1e-5) end early.
"""

from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pandas as pd

from teamslam.geometry import Pose
from teamslam.model import Dataset, Kind, Values, landmark_key, pose_key


def from_files(log: Path, dataset: Dataset, stages: Any) -> Values:
    """The team's optimum by GTSAM, from the CSV files of a simulated team."""
    robots = sorted(dataset.robots)
    files = stages("read", lambda: {
        what: {r: pd.read_csv(log / f"{what}_{r}.csv") for r in robots if (log / f"{what}_{r}.csv").exists()}
        for what in ("odometry", "landmarks", "robots")
    })  # fmt: skip
    noise = {t.source: np.linalg.inv(t.whitening[0].T @ t.whitening[0]) for t in dataset.tables}
    start = stages("start", lambda: dead_reckoned(files, robots))
    graph, initial = stages("build", lambda: problem(files, robots, start, noise))
    found = stages("solve", lambda: gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters()).optimize())
    return stages("read back", lambda: values_of(found, start))


def parameters() -> Any:
    found = gtsam.LevenbergMarquardtParams()
    found.setOrderingType("METIS")
    found.setRelativeErrorTol(1e-8)
    found.setAbsoluteErrorTol(0.0)
    found.setMaxIterations(100)
    return found


def dead_reckoned(files: Any, robots: list[int]) -> dict[str, Any]:
    ways = {}
    for r in robots:
        steps = files["odometry"][r][["x", "y", "theta"]].to_numpy()
        heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
        c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
        moved = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], -1)
        ways[r] = np.column_stack([np.vstack([[0.0, 0.0], np.cumsum(moved, 0)]), heading])
    placed, poses = {robots[0]}, {robots[0]: ways[robots[0]]}
    while len(placed) < len(robots):
        before = len(placed)
        for seer, table in files["robots"].items():
            for row in table.itertuples():
                other, here, there = int(row.other), round(row.stamp), round(row.other_stamp)
                if (seer in placed) == (other in placed):
                    continue
                z = gtsam.Pose2(row.x, row.y, row.theta)
                known, new = (seer, other) if seer in placed else (other, seer)
                at, then = (here, there) if known == seer else (there, here)
                target = gtsam.Pose2(*poses[known][at]).compose(z if known == seer else z.inverse())
                shift = target.compose(gtsam.Pose2(*ways[new][then]).inverse())
                R = shift.rotation().matrix()
                xy = ways[new][:, :2] @ R.T + shift.translation()
                poses[new] = np.column_stack([xy, ways[new][:, 2] + shift.theta()])
                placed.add(new)
        if len(placed) == before:
            raise RuntimeError("the robots have not all seen each other")
    marks: dict[int, np.ndarray] = {}
    for r, table in files["landmarks"].items():
        first = table.drop_duplicates("landmark")
        at = poses[r][first["stamp"].round().astype(int)]
        c, s, z = np.cos(at[:, 2]), np.sin(at[:, 2]), first[["x", "y"]].to_numpy()
        places = at[:, :2] + np.stack([c * z[:, 0] - s * z[:, 1], s * z[:, 0] + c * z[:, 1]], -1)
        for name, place in zip(first["landmark"].tolist(), places, strict=True):
            marks.setdefault(int(name), place)
    return {"poses": poses, "marks": marks}


def problem(files: Any, robots: list[int], start: Any, noise: Any) -> tuple[Any, Any]:
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for r, way in start["poses"].items():
        for k, pose in enumerate(way.tolist()):
            initial.insert(key(r, k), gtsam.Pose2(*pose))
    for name, place in start["marks"].items():
        initial.insert(name, place)
    first = key(robots[0], 0)
    graph.push_back(gtsam.NonlinearEqualityPose2(first, initial.atPose2(first)))
    steps, seen = (gtsam.noiseModel.Gaussian.Covariance(noise[what]) for what in ("odometry", "robots"))
    for r, table in files["odometry"].items():
        for k, z in enumerate(table[["x", "y", "theta"]].to_numpy().tolist()):
            graph.push_back(gtsam.BetweenFactorPose2(key(r, k), key(r, k + 1), gtsam.Pose2(*z), steps))
    for r, table in files["robots"].items():
        for row in table.itertuples():
            z = gtsam.Pose2(row.x, row.y, row.theta)
            graph.push_back(
                gtsam.BetweenFactorPose2(key(r, round(row.stamp)), key(int(row.other), round(row.other_stamp)), z, seen)
            )
    sigma = float(np.sqrt(noise["landmarks"][0, 0]))
    for r, table in files["landmarks"].items():
        xy = table[["x", "y"]].to_numpy()
        ranges, bearings = np.hypot(*xy.T), np.arctan2(xy[:, 1], xy[:, 0])
        observers, names = table["stamp"].round().astype(int).tolist(), table["landmark"].astype(int).tolist()
        for k, name, distance, bearing in zip(observers, names, ranges.tolist(), bearings.tolist(), strict=True):
            sd = gtsam.noiseModel.Diagonal.Sigmas(np.array([sigma / distance, sigma]))
            graph.push_back(gtsam.BearingRangeFactor2D(key(r, k), name, gtsam.Rot2(bearing), distance, sd))
    return graph, initial


def key(robot: int, k: int) -> int:
    return robot * 10_000_000 + k


def values_of(found: Any, start: Any) -> Values:
    keys, poses = [], []
    for r, way in start["poses"].items():
        keys.append(pose_key(r, np.arange(len(way)) * 1_000_000))
        poses += [(p.x(), p.y(), p.theta()) for p in (found.atPose2(key(r, k)) for k in range(len(way)))]
    names = sorted(start["marks"])
    points = np.array([found.atPoint2(name) for name in names])
    values = {Kind.POSE2: (np.concatenate(keys), Pose.from_xytheta(np.array(poses)))}
    return Values.of({**values, Kind.POINT2: (landmark_key(np.array(names)), points)})
