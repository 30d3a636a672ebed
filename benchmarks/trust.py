"""What it costs to ask how far a map is to be believed, beside building and joining.

    python benchmarks/trust.py [LOG ...] [--runs 3]

Simulated teams, and logs that are named. Processor time of this process, the least of some runs of the defaults.
"""

import argparse
import os
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import teamslam
from teamslam.model import Dataset
from teamslam.pipeline import run
from teamslam.sim import Options, simulate

SOLVE = ("building submaps", "joining submaps")
ASKED = ("suspicions", "weak directions")
TEAMS = (
    Options(space="2d", robots=4, poses=150, landmarks=60),
    Options(space="2d", robots=5, poses=600, landmarks=200),
    Options(space="3d", robots=5, poses=600, landmarks=200),
)


def logs(paths: list[Path]) -> Iterator[tuple[str, Dataset]]:
    """What is measured, with its name."""
    for path in paths:
        yield path.name, teamslam.read(path)
    for team in TEAMS:
        yield (
            f"{team.space}, {team.robots} robots, {team.poses} poses each, {team.landmarks} landmarks",
            simulate(team, 1),
        )


def stages(log: Dataset) -> dict[str, float]:
    """Processor time of each stage of a run [s]."""
    began = [("", time.process_time())]

    def hear(stage: str, done: int, of: int) -> None:
        if stage != began[-1][0]:
            began.append((stage, time.process_time()))

    run(log, progress=hear)
    began.append(("", time.process_time()))
    return {stage: after - start for (stage, start), (_, after) in pairwise(began[1:])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="*")
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    print(f"| log | solve, s | {' | '.join(ASKED)} |\n|---|---|{'---|' * len(ASKED)}")
    for name, log in logs(given.logs):
        runs = [stages(log) for _ in range(given.runs)]
        solve = min(sum(r[stage] for stage in SOLVE) for r in runs)
        shares = " | ".join(f"{min(r[stage] for r in runs) / solve:.0%}" for stage in ASKED)
        print(f"| {name} | {solve:.2f} | {shares} |", flush=True)


if __name__ == "__main__":
    main()
