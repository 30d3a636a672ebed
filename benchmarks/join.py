"""Joining many local maps: from loaded submaps (arrays) to the optimum and its information.

    python benchmarks/join.py [--repetitions 9] [--json FILE]

Two problems: the 200 published local maps of Victoria Park, and a simulated chain of 700 local maps with 4,200
landmarks. In the simulation a robot drives rows of a square; every local map holds its end pose and the landmarks
within reach in the frame of its start, with a random dense information matrix and an estimate drawn from it.
"""

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import teamslam as ts
from datasets import VICTORIA_PARK, folder_of
from memory import forget_peak, peak_mb
from problems import exp
from run import machine
from teamslam.geometry import Pose
from teamslam.model import Kind, Names, Sources, Stretch, Submap, Values, landmark_key, pose_key

MAPS, LANDMARKS, STEP_M, REACH_M = 700, 4_200, 10.0, 12.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    problems = {
        "Victoria Park, 200 local maps": ts.read_submaps(folder_of(VICTORIA_PARK)),
        "simulated chain, 700 local maps": chain(seed=0),
    }
    rows = [measure(name, submaps, options.repetitions) for name, submaps in problems.items()]
    print(f"{machine()}, teamslam {ts.__version__}\n")
    print("| problem | landmarks | unknowns | median ms | min - max | cpu ms | iterations | peak MB | cost |")
    print("|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r['problem']} | {r['landmarks']} | {r['unknowns']} | {r['total_ms']:.1f} "
            f"| {r['min_ms']:.1f} - {r['max_ms']:.1f} | {r['cpu_ms']:.1f} | {r['iterations']} | {r['peak_mb']:.0f} "
            f"| {r['cost']:.6f} |"
        )
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")


def measure(name: str, submaps: list[Submap], repetitions: int) -> dict[str, Any]:
    """One line of the table; the first of the joins warms caches up and is not counted."""
    times, used = [], []
    before, peak = forget_peak(), 0.0
    for repetition in range(repetitions + 1):
        clock, began = time.process_time(), time.perf_counter()
        joined = ts.join(submaps)
        if repetition:
            times.append(1e3 * (time.perf_counter() - began))
            used.append(1e3 * (time.process_time() - clock))
        else:
            peak = peak_mb() - before
    assert joined.converged and len(joined.components) == 1
    solution = joined.components[0].solution
    return {
        "problem": name, "landmarks": len(joined.map.landmark_keys), "unknowns": joined.map.dof,
        "total_ms": statistics.median(times), "min_ms": min(times), "max_ms": max(times),
        "cpu_ms": statistics.median(used), "iterations": solution.iterations, "peak_mb": peak, "cost": solution.cost,
    }  # fmt: skip


def chain(seed: int) -> list[Submap]:
    """The simulated chain."""
    rng = np.random.default_rng(seed)
    side = np.sqrt(LANDMARKS * 20.0)
    landmarks = rng.uniform(0.0, side, (LANDMARKS, 2))
    along = np.arange(MAPS + 1) * STEP_M
    row, within = np.divmod(along, side)
    x = np.where(row % 2 == 0, within, side - within)
    heading = np.where(row % 2 == 0, 0.0, np.pi) + rng.normal(0.0, 0.1, MAPS + 1)
    way = Pose(exp(heading[:, None]), np.stack([x, row * side / (row[-1] + 1.0)], -1))
    return [local_map(rng, k, way[k], way[k + 1], landmarks) for k in range(MAPS)]


def local_map(rng: np.random.Generator, k: int, start: Pose, end: Pose, landmarks: np.ndarray) -> Submap:
    """Map k: the end pose and the landmarks about its middle, in the frame of its start."""
    middle = 0.5 * (start.translation + end.translation)
    near = np.flatnonzero(np.linalg.norm(landmarks - middle, axis=1) < REACH_M)
    truth = Values.of({
        Kind.POSE2: (pose_key(1, np.array([k + 1])), start.between(end)[None]),
        Kind.POINT2: (landmark_key(near), start.unact(landmarks[near])),
    })  # fmt: skip
    n = truth.layout.dof
    root = rng.normal(0.0, 1.0, (n, n)) / np.sqrt(n)
    sigmas = np.r_[0.02, 0.02, 0.002, np.full(n - 3, 0.05)]
    information = (root @ root.T + np.eye(n)) / np.outer(sigmas, sigmas)
    drawn = np.linalg.solve(np.linalg.cholesky(information).T, rng.normal(0.0, 1.0, n))
    return Submap(
        id=f"1/{k}", version=1, base=int(pose_key(1, k)), base_dim=2, values=truth.retract(drawn),
        information=sp.csr_array(information), sources=Sources({Stretch(1, "simulated", k, k + 1)}),
        names=Names(tick_s=1.0), rows=n,
    )  # fmt: skip


if __name__ == "__main__":
    main()
