"""What all that is on by default costs beside building and joining: is the noise as stated, does the map fit, who lies,
what is not known.

    python benchmarks/trust.py [LOG ...] [--runs 3]

Simulated teams, and logs that are named. Processor time of this process, the least of some runs of the defaults, stage
by stage. Moved, what asks first, counts the log linearised at the map, which all others use as well, and names that lie
beyond doubt; calibration the map made once more, where anything is put right.
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
ASKED = {
    "moved": ("landmarks that were moved",),
    "calibration": ("calibration", "once more, put right"),
    "verdict": ("verdict on the fit",),
    "suspicions": ("suspicions",),
    "weak directions": ("weak directions",),
}
TEAMS = (
    Options(space="2d", robots=4, poses=150, landmarks=60),
    Options(space="2d", robots=5, poses=600, landmarks=200),
    Options(space="planar", robots=5, poses=600, landmarks=200),
    Options(space="3d", robots=5, poses=600, landmarks=200),
    Options(space="2d", robots=5, poses=10_000, landmarks=500),
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
    """Processor time of each stage of a run [s]; a stage that comes twice is summed."""
    began = [("", time.process_time())]

    def hear(stage: str, done: int, of: int) -> None:
        if stage != began[-1][0]:
            began.append((stage, time.process_time()))

    run(log, progress=hear)
    began.append(("", time.process_time()))
    spent: dict[str, float] = {}
    for (stage, start), (_, after) in pairwise(began[1:]):
        spent[stage] = spent.get(stage, 0.0) + after - start
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="*")
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    print(f"| log | solve, s | {' | '.join(ASKED)} | together |\n|---|---|{'---|' * (len(ASKED) + 1)}")
    for name, log in logs(given.logs):
        runs = [stages(log) for _ in range(given.runs)]
        least = {stage: min(r.get(stage, 0.0) for r in runs) for stage in {s for r in runs for s in r}}
        solve = sum(least[stage] for stage in SOLVE)
        shares = [sum(least.get(stage, 0.0) for stage in stages) / solve for stages in ASKED.values()]
        print(f"| {name} | {solve:.2f} | {' | '.join(f'{x:.0%}' for x in (*shares, sum(shares)))} |", flush=True)


if __name__ == "__main__":
    main()
