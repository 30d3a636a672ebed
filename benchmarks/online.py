"""Mapping while driving: what a step takes and how far off the pose is that is there after it.

    python benchmarks/online.py [--poses 10000] [--landmarks 300] [--dims 2 3] [--solvers ...] [--json FILE]

One robot drives about a made-up world (`teamslam.simulate`); its odometry and sightings come one pose at a time. Beside
teamslam stand GTSAM's iSAM2 and its incremental fixed-lag smoother (the last 100 poses, and landmarks as long as they
are seen), each in a process of its own, each on the same log: the sightings as bearing and range, as the wheel has no
factor for points, with the same noise to first order; relinearised at every step. A step is from the rows to the pose
of now: with its covariance from teamslam, without from GTSAM. Building and joining run beside teamslam's steps, and
what they take stands in `beside_ms`, one number for each submap (their median and largest). Closing a submap and
beginning anew from the map belong to the step in which they happen. `cpu_` is the time of the processor, for machines
on which others work as well.

`online_rmse_m`: of the positions as they were known at the time, in the frame of the first pose. `final_rmse_m`: of the
whole way at the end (of the smoother, as published: it keeps no more).
"""

import argparse
import gc
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import teamslam as ts
from memory import forget_peak, peak_mb
from run import machine
from teamslam.geometry import Pose
from teamslam.live import mapped, replayed
from teamslam.model import Dataset, Table, is_landmark
from teamslam.model.sensors import pose_of
from teamslam.robot import Atlas, Options, Robot
from teamslam.sim.scenario import Options as World
from teamslam.sim.scenario import simulate_options

LAG = 100  # poses in the fixed-lag smoother, and of a submap
SOLVERS = ("teamslam", "isam2", "fixed_lag")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--landmarks", type=int, default=300)
    parser.add_argument("--path", default="random_walk")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dims", type=int, nargs="+", default=[2, 3])
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SOLVERS))
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    parser.add_argument("--alone", action="store_true", help="one solver, in this process; prints a line of JSON")
    options = parser.parse_args()
    if options.alone:
        print(json.dumps(measure(options.solvers[0], options.dims[0], options)), flush=True)
        return
    rows = [in_its_own_process(s, dim, options) for dim in options.dims for s in options.solvers]
    print(f"{machine()}\n")
    print("| solver | dim | median ms | p99 | max | second half | cpu: median, p99, max | online m | final m | MB |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r['solver']} | {r['dim']} | {r['median_ms']:.2f} | {r['p99_ms']:.2f} | {r['max_ms']:.2f} "
            f"| {r['second_half_median_ms']:.2f} "
            f"| {r['cpu_median_ms']:.2f}, {r['cpu_p99_ms']:.2f}, {r['cpu_max_ms']:.2f} "
            f"| {r['online_rmse_m']:.4f} | {r['final_rmse_m']:.4f} | {r['memory_mb']:.0f} |"
        )
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")


def in_its_own_process(solver: str, dim: int, options: argparse.Namespace) -> dict[str, Any]:
    """One line of the table."""
    command = [sys.executable, __file__, "--alone", "--solvers", solver, "--dims", str(dim), "--path", options.path]
    command += [f"--{name}={getattr(options, name)}" for name in ("poses", "landmarks", "seed")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{solver}, {dim}D: {done.stderr}")
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


def measure(solver: str, dim: int, options: argparse.Namespace) -> dict[str, Any]:
    """The row of a solver, in this process."""
    world = World(space=f"{dim}d", robots=1, poses=options.poses, landmarks=options.landmarks, path=options.path)
    log = simulate_options(world, options.seed)
    moments = [tables for _, tables in replayed(log, 1)]
    truth = log.truth
    assert truth is not None
    poses = truth.poses_of(log.pose_keys[1], dim)
    way = poses[0].between(poses).translation
    stepper = STEPPERS[solver](log)
    gc.collect()
    before = forget_peak()
    taken, used, positions = [], [], []
    for tables in moments:
        rows = stepper.prepare(tables)
        began, clock = time.perf_counter(), time.thread_time()
        position = stepper.step(rows)
        used.append(1e3 * (time.thread_time() - clock))
        taken.append(1e3 * (time.perf_counter() - began))
        positions.append(np.array(position))
        stepper.beside()
    memory = peak_mb() - before
    half = len(taken) // 2
    final = stepper.final()
    return {
        "solver": solver, "dim": dim, "poses": options.poses, "landmarks": len(log.landmark_keys),
        "rows": sum(map(len, log.tables)), "median_ms": statistics.median(taken),
        "p99_ms": float(np.quantile(taken, 0.99)), "max_ms": max(taken),
        "cpu_median_ms": statistics.median(used), "cpu_p99_ms": float(np.quantile(used, 0.99)), "cpu_max_ms": max(used),
        "first_half_median_ms": statistics.median(taken[:half]),
        "second_half_median_ms": statistics.median(taken[half:]), "online_rmse_m": rmse(np.array(positions), way),
        "final_rmse_m": rmse(np.array(positions) if final is None else final, way), "memory_mb": memory,
        **stepper.more(),
    }  # fmt: skip


def rmse(positions: np.ndarray, way: np.ndarray) -> float:
    """Of all poses but the first, which is known."""
    return float(np.sqrt(np.mean(np.sum((positions[1:] - way[1:]) ** 2, -1))))


class Ours:
    """teamslam: a robot that steps, its maps beside it."""

    def __init__(self, log: Dataset) -> None:
        self.log = log
        self.robot, self.atlas = Robot.of(log, 1, Options(poses_per_piece=LAG)), Atlas()
        self.start: Any = None
        self.beside_ms: list[float] = []

    def prepare(self, tables: list[Table]) -> list[Table]:
        return tables

    def step(self, tables: list[Table]) -> np.ndarray:
        if self.start is not None:
            self.robot, self.start = self.robot.renew(self.start), None
        self.robot = self.robot.step(tables)
        if self.robot.due:
            self.robot = self.robot.close()
        now = self.robot.now
        assert now is not None
        return now.pose.translation

    def beside(self) -> None:
        if len(self.robot.closed) == len(self.atlas.stretches):
            return
        began = time.perf_counter()
        self.atlas, self.start = mapped(self.atlas, self.robot)
        self.beside_ms.append(1e3 * (time.perf_counter() - began))

    def final(self) -> np.ndarray:
        last = self.robot.finish()
        atlas, _ = mapped(self.atlas, last)
        joined = ts.join(atlas.submaps)
        values = joined.map.all_values
        return values.positions(self.log.pose_keys[1], self.log.robots[1])

    def more(self) -> dict[str, Any]:
        return {"beside_ms": {"median": statistics.median(self.beside_ms), "max": max(self.beside_ms)}}


class Gtsam:
    """What iSAM2 and the fixed-lag smoother have in common: factors of one pose, and where things begin."""

    def __init__(self, log: Dataset) -> None:
        import gtsam

        self.g, self.log, self.dim = gtsam, log, log.robots[1]
        self.poses = {int(key): n for n, key in enumerate(log.pose_keys[1])}
        self.known: set[int] = set()
        self.now: Any = None
        self.number = -1

    def key(self, key: int) -> int:
        return int(key) + (1 << 40) if is_landmark(key) else self.poses[int(key)]

    def prepare(self, tables: list[Table]) -> tuple[Any, Any, list[int]]:
        """Factors, first values and the keys of this pose, made from the pose before: no part of the step."""
        g, graph, values = self.g, self.g.NonlinearFactorGraph(), self.g.Values()
        self.number += 1
        flat = self.dim == 2
        noise = g.noiseModel.Diagonal.Sigmas
        step = next((t for t in tables if t.model == "relative_pose" and t.source == "odometry"), None)
        if step is None:
            here = g.Pose2() if flat else g.Pose3()
            graph.push_back(
                (g.PriorFactorPose2 if flat else g.PriorFactorPose3)(0, here, noise(np.full(here.dim(), 1e-6)))
            )
        else:
            sigma = 1.0 / np.diagonal(step.whitening[0])
            moved = self.pose(pose_of(step.values, self.dim)[0])
            here = self.now.compose(moved)
            factor = g.BetweenFactorPose2 if flat else g.BetweenFactorPose3
            between = noise(sigma if flat else np.r_[sigma[3:], sigma[:3]])
            graph.push_back(factor(self.number - 1, self.number, moved, between))
        values.insert(self.number, here)
        keys = [self.number]
        for table in tables:
            if table.source != "landmarks":
                continue
            sigma_m = 1.0 / np.diagonal(table.whitening[0])[0]
            for mark, z in zip(table.keys[:, 1].tolist(), table.values, strict=True):
                key, away = self.key(mark), float(np.linalg.norm(z))
                bearing = g.Rot2(np.arctan2(z[1], z[0])) if flat else g.Unit3(z)
                factor = g.BearingRangeFactor2D if flat else g.BearingRangeFactor3D
                sigmas = np.r_[np.full(self.dim - 1, sigma_m / away), sigma_m]
                graph.push_back(factor(self.number, key, bearing, away, noise(sigmas)))
                if key not in self.known:
                    self.known.add(key)
                    values.insert(key, here.transformFrom(z))
                keys.append(key)
        return graph, values, keys

    def pose(self, pose: Pose) -> Any:
        if self.dim == 2:
            return self.g.Pose2(*pose.xytheta())
        return self.g.Pose3(self.g.Rot3(pose.rotation), pose.translation)

    def beside(self) -> None:
        """Nothing runs beside it."""

    def more(self) -> dict[str, Any]:
        return {}


class Isam2(Gtsam):
    """GTSAM's iSAM2."""

    def __init__(self, log: Dataset) -> None:
        super().__init__(log)
        params = self.g.ISAM2Params()
        params.relinearizeSkip = 1
        self.isam = self.g.ISAM2(params)

    def step(self, rows: tuple[Any, Any, list[int]]) -> np.ndarray:
        graph, values, _ = rows
        self.isam.update(graph, values)
        self.now = (self.isam.calculateEstimatePose2 if self.dim == 2 else self.isam.calculateEstimatePose3)(
            self.number
        )
        return np.array(self.now.translation())

    def final(self) -> np.ndarray:
        values = self.isam.calculateBestEstimate()
        at = values.atPose2 if self.dim == 2 else values.atPose3
        return np.array([at(n).translation() for n in range(len(self.poses))])


class FixedLag(Gtsam):
    """GTSAM's incremental fixed-lag smoother."""

    def __init__(self, log: Dataset) -> None:
        super().__init__(log)
        params = self.g.ISAM2Params()
        params.relinearizeSkip = 1
        self.smoother = self.g.IncrementalFixedLagSmoother(float(LAG), params)

    def prepare(self, tables: list[Table]) -> tuple[Any, Any, list[int]]:
        held = self.smoother.getLinearizationPoint()
        self.known = {key for key in self.known if held.exists(key)}
        return super().prepare(tables)

    def step(self, rows: tuple[Any, Any, list[int]]) -> np.ndarray:
        graph, values, keys = rows
        self.smoother.update(graph, values, dict.fromkeys(keys, float(self.number)))
        at = self.smoother.calculateEstimatePose2 if self.dim == 2 else self.smoother.calculateEstimatePose3
        self.now = at(self.number)
        return np.array(self.now.translation())

    def final(self) -> None:
        return None


STEPPERS: dict[str, Any] = {"teamslam": Ours, "isam2": Isam2, "fixed_lag": FixedLag}

if __name__ == "__main__":
    main()
