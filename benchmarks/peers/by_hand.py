"""What people do by hand, in the plane: pandas for files, dead reckoning by NumPy, somebody's solver for the optimum.

    python benchmarks/peers/by_hand.py gtsam|ceres|g2o LOG ROWS.json MAP.npz

LOG is a simulated team's folder of CSV files. A process of its own, so that it can be stopped: rows {stage, seconds}
and the map are written once the optimum is found.
"""

import json
import sys
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

T = TypeVar("T")
SOLVERS = {"gtsam": "by_hand_gtsam", "ceres": "by_hand_native", "g2o": "by_hand_native"}
WHAT = ("odometry", "landmarks", "robots")


class Stages:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        began = time.perf_counter()
        result = work()
        self.rows.append({"stage": stage, "seconds": time.perf_counter() - began})
        return result


@dataclass(frozen=True, eq=False)
class Log:
    """One table of each kind for each robot, and the covariance of each kind's rows."""

    robots: list[int]
    tables: dict[str, dict[int, pd.DataFrame]]
    noise: dict[str, np.ndarray]

    @classmethod
    def read(cls, folder: Path) -> "Log":
        about = tomllib.loads((folder / "team.toml").read_text())
        robots = [robot["number"] for robot in about["robot"]]
        files = {what: {r: folder / f"{what}_{r}.csv" for r in robots} for what in WHAT}
        tables = {what: {r: pd.read_csv(f) for r, f in of.items() if f.exists()} for what, of in files.items()}
        return cls(robots, tables, {log["source"]: np.array(log["covariance"]) for log in about["log"]})


@dataclass(frozen=True, eq=False)
class Map:
    """Poses (n, 3) [m, m, rad] of each robot in time order, and landmarks by number."""

    poses: dict[int, np.ndarray]
    marks: dict[int, np.ndarray]

    def save(self, path: Path) -> None:
        names = sorted(self.marks)
        ways = {f"robot_{r}": way for r, way in self.poses.items()}
        np.savez(path, names=names, marks=np.array([self.marks[n] for n in names]), **ways)


def main() -> None:
    solver, folder, rows, out = sys.argv[1], *map(Path, sys.argv[2:])
    solve = import_module(SOLVERS[solver]).solve
    stages = Stages()
    log = stages("read", lambda: Log.read(folder))
    start = stages("start", lambda: dead_reckoned(log))
    found: Map = solve(solver, log, start, stages)
    found.save(out)
    rows.write_text(json.dumps(stages.rows))


def dead_reckoned(log: Log) -> Map:
    """Each robot along its odometry, the first from the origin, others from where somebody who has a place saw them or
    was seen by them; each landmark where it was first seen."""
    ways = {r: way(log.tables["odometry"][r]) for r in log.robots}
    first = log.robots[0]
    poses = {first: ways[first]}
    while len(poses) < len(ways):
        robot, placed = next(placements(log, ways, poses), (None, None))
        if robot is None:
            raise RuntimeError("the robots have not all seen each other")
        poses[robot] = placed
    marks: dict[int, np.ndarray] = {}
    for r, table in log.tables["landmarks"].items():
        seen = table.drop_duplicates("landmark")
        at = poses[r][seen["stamp"].round().astype(int)]
        c, s, z = np.cos(at[:, 2]), np.sin(at[:, 2]), seen[["x", "y"]].to_numpy()
        places = at[:, :2] + np.stack([c * z[:, 0] - s * z[:, 1], s * z[:, 0] + c * z[:, 1]], -1)
        for name, place in zip(seen["landmark"].tolist(), places, strict=True):
            marks.setdefault(int(name), place)
    return Map({r: poses[r] for r in log.robots}, marks)


def way(odometry: pd.DataFrame) -> np.ndarray:
    """A robot's way from the origin, by its odometry alone."""
    steps = odometry[["x", "y", "theta"]].to_numpy()
    heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    moved = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], -1)
    return np.column_stack([np.vstack([[0.0, 0.0], np.cumsum(moved, 0)]), heading])


def placements(log: Log, ways: dict[int, np.ndarray], poses: dict[int, np.ndarray]) -> Any:
    """Robots without a place that a sighting ties to one with a place, and their ways there."""
    for seer, table in log.tables["robots"].items():
        for row in table.itertuples():
            other, z = int(row.other), np.array([row.x, row.y, row.theta])
            here, there = round(row.stamp), round(row.other_stamp)
            if seer in poses and other not in poses:
                yield other, moved_to(compose(poses[seer][here], z), ways[other], there)
            elif other in poses and seer not in poses:
                yield seer, moved_to(compose(poses[other][there], inverse(z)), ways[seer], here)


def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    c, s = np.cos(a[2]), np.sin(a[2])
    turned = np.stack([c * b[..., 0] - s * b[..., 1], s * b[..., 0] + c * b[..., 1]], -1)
    return np.concatenate([a[:2] + turned, a[2] + b[..., 2:]], -1)


def inverse(a: np.ndarray) -> np.ndarray:
    c, s = np.cos(a[2]), np.sin(a[2])
    return np.array([-c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2]])


def moved_to(place: np.ndarray, whole: np.ndarray, at: int) -> np.ndarray:
    """A way moved as a body so that its pose `at` comes to a place."""
    return compose(compose(place, inverse(whole[at])), whole)


if __name__ == "__main__":
    main()
