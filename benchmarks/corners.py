"""Corners of tags: all frames and tags by least squares over all corners, beside Ceres and GTSAM from their wheels.

    python benchmarks/corners.py [--frames 10000] [--tags 40] [--seed 0] [--rounds 3] [--json FILE]

The problem is that of corner_problem.py, the solvers are those of peers/corners.py. Each stops when a step gains less
than 1e-8 of the cost; all are judged by one neutral cost. Ceres and GTSAM call a cost function in Python for each tag
in each frame, as people write it who use them from Python: nearly all of their time goes there. Each measurement is a
process of its own, and rounds go through all solvers in turn. Where others use the machine, the seconds of processors
that a process took, on all its threads, tell more than those of the clock.
"""

import argparse
import json
import multiprocessing
import statistics
import time
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from corner_problem import cost, problem
from peers.corners import SOLVERS

FIELDS = ("solver", "version", "build_s", "solve_s", "processor_s", "steps", "cost", "tags_mm")


def measured(solver: str, frames: int, tags: int, seed: int) -> dict[str, Any]:
    """One solver, once."""
    of, truth = problem(frames, tags, seed)
    package, solve = SOLVERS[solver]
    began = time.process_time()
    ways, walls, steps, build_s, solve_s = solve(of)
    processor_s = time.process_time() - began
    off = float(1e3 * np.sqrt(np.mean(np.sum((walls.T - truth.T) ** 2, -1))))
    numbers = (build_s, solve_s, processor_s, steps, cost(of, ways, walls), off)
    return dict(zip(FIELDS, (solver, version(package), *numbers), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--tags", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    of, _ = problem(asked.frames, asked.tags, asked.seed)
    print(f"{len(of.frames.T)} frames, {len(of.tags.T)} tags, {len(of.frame)} sightings of four corners")
    names = [name for name, (package, _) in SOLVERS.items() if find_spec(package)]
    for name in SOLVERS.keys() - set(names):
        print(f"{name}: not installed; pip install {SOLVERS[name][0]}")
    rows = []
    for _ in range(asked.rounds):
        for name in names:
            process = multiprocessing.get_context("spawn").Pool(1)
            rows.append(process.apply(measured, (name, asked.frames, asked.tags, asked.seed)))
            process.close()
            process.join()
    print("| solver | build [s] | solve [s] | both, processors [s] | steps | cost | tags off [mm] |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for name in names:
        mine = [row for row in rows if row["solver"] == name]
        build, solve, both = (statistics.median(row[part] for row in mine) for part in FIELDS[2:5])
        last = mine[-1]
        print(f"| {name} {last['version']} | {build:.2f} | {solve:.2f} | {both:.2f} | {last['steps']} | "
              f"{last['cost']:.4f} | {last['tags_mm']:.3f} |")  # fmt: skip
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
