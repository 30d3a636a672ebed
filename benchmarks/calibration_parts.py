"""Calibration by few robots: pairs and triples of real robots, and halves of their logs by time, each mapped alone.

    python benchmarks/calibration_parts.py MRCLAM_Dataset6 MRCLAM_Dataset7 --out docs/benchmarks/calibration_parts.md

Full least squares. RMSE of robots and of landmarks [m] after one alignment of the whole team, and by which share
landmarks are farther apart than in truth (*size*), each the root of the mean square over the parts of a group; NEES/dof
on average over these, as in calibration_logs.py.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from calibration_halves import Rows, by_time, cut
from calibration_logs import METHODS, numbers
from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray
from teamslam.io import read
from teamslam.metrics.frames import align_team
from teamslam.model import Dataset, Table, is_landmark, is_pose, robot_of
from teamslam.pipeline import Result, run

HEAD = """# Calibration by few robots

Written by `{command}`.

```text
{what}
```

| parts | | robots | landmarks | size | landmarks, NEES/dof | position | heading | each landmark | whole |
|---|---|---|---|---|---|---|---|---|---|
"""
GROUPS = {"pairs": 2, "triples": 3}


def main() -> None:
    """Cut, map, score and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    command = "python benchmarks/calibration_parts.py " + " ".join(log.name for log in asked.logs)
    page = HEAD.format(command=command, what=(__doc__ or "").strip().split("\n\n", 2)[2])
    print(page, end="", flush=True)
    for path in asked.logs:
        log = read(path)
        for name, parts in groups(log):
            for line in lines(f"{path.name}, {name}", log, parts):
                print(line, flush=True)
                page += line + "\n"
    if asked.out:
        asked.out.write_text(page)


def groups(log: Dataset) -> Iterator[tuple[str, list[Rows]]]:
    """The parts of a log, by what they are."""
    for name, count in GROUPS.items():
        yield name, [_among(robots) for robots in combinations(log.robots, count)]
    yield "halves", list(by_time(log))


def lines(name: str, log: Dataset, parts: list[Rows]) -> Iterator[str]:
    """As stated, and calibrated, over the parts that both ways make one map of."""
    scores: dict[bool, list[Array | None]] = {False: [], True: []}
    for rows in parts:
        part = log.with_tables(cut(log, rows))
        for calibrate, found in scores.items():
            try:
                result = run(part, replace(METHODS["full"], calibrate=calibrate))
                found.append(np.array([*numbers(result), size(result)]) if len(result.maps) == 1 else None)
            except SolveError:
                found.append(None)
    both = [k for k, pair in enumerate(zip(*scores.values(), strict=True)) if all(each is not None for each in pair)]
    for calibrate, found in scores.items():
        told = np.array([found[k] for k in both])
        nees, rms = told[:, :5].mean(0), np.sqrt(np.mean(told[:, 5:] ** 2, 0))
        label = "| calibrated" if calibrate else f"{name}, {len(both)} of {len(parts)} | as stated"
        cells = [*(f"{x:.4f}" for x in rms), *(f"{x:.2f}" for x in nees)]
        yield f"| {label} | {' | '.join(cells)} |"


def size(result: Result) -> float:
    """By what share landmarks are farther apart than in truth."""
    assert result.truth is not None
    aligned = align_team(result.map, result.truth)
    assert aligned is not None
    keys = aligned.keys[is_landmark(aligned.keys)]
    found, true = (values.positions(keys, 2) for values in (result.map.all_values, result.truth))
    apart = [np.sum((places - places.mean(0)) ** 2) for places in (found, true)]
    return float(np.sqrt(apart[0] / apart[1]) - 1.0)


def _among(robots: tuple[int, ...]) -> Rows:
    """Rows of some robots, about none of the others."""

    def rows(table: Table) -> BoolArray:
        known = np.isin(robot_of(table.keys), robots) | ~is_pose(table.keys)
        return np.asarray(known.all(-1) & (table.robot in robots))

    return rows


if __name__ == "__main__":
    main()
