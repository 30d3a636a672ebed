"""How far robots turn of what their commands say, and what that and their cameras leave in a map.

    python benchmarks/calibration_turns.py MRCLAM_Dataset9 MRCLAM_Dataset6 \\
        --out docs/benchmarks/calibration_turns.md

By the map (full least squares, calibrated; no truth): how far a robot turned in all steps in which it was told to turn
by more than 0.15 rad/s, over what it was told, on the spot (up to 0.03 m/s) and under way (at 0.7 of its usual speed
and more) to its left and to its right, where there are 30 such steps. `bearing scale`: by which share the bearings of
landmarks, and of robots, are too large, where it is let in beside the other terms and chosen by the marginal
likelihood; the two know nothing of each other.

Then what the map of the first log is when the commands of robots under way turn by the shares found (*turns*), when the
bearings' scale is a term (*bearings*), and with both: NEES/dof of landmarks together and of each, their RMSE [m], and
its halves by robots and by time as in calibration_halves.py: `apart` (1 where both halves know what they claim; no
truth is in it), `common` and what `common` would be if the truth were off by 5 mm.
"""

import argparse
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from calibration_halves import Half, by_robots, by_time, compared, cut
from calibration_logs import METHODS, numbers
from teamslam.geometry import Array, Pose
from teamslam.io import read
from teamslam.model import Dataset, Table
from teamslam.model.sensors import pose_of
from teamslam.pipeline import Result, run
from teamslam.trust.calibration import terms

SPOT, TURNING = 0.03, 0.15  # m/s, rad/s
UNDER_WAY, FEWEST = 0.7, 30  # of the usual speed; steps
HEAD = """# Robots that turn less under way than they are told

Written by `{command}`.

```text
{what}
```

| log, robot | on the spot | under way, left | right | bearing scale: landmarks | robots |
|---|---|---|---|---|---|
"""
MAPS = """
| {log} | landmarks | each landmark | RMSE | by robots: apart | common | 5 mm | by time: apart | common | 5 mm |
|---|---|---|---|---|---|---|---|---|---|
"""
Ratios = dict[int, tuple[float, float]]


def main() -> None:
    """Map, measure, put right and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    command = "python benchmarks/calibration_turns.py " + " ".join(log.name for log in asked.logs)
    page = HEAD.format(command=command, what=(__doc__ or "").strip().split("\n\n", 2)[2])
    print(page, end="", flush=True)
    for path in asked.logs:
        log = read(path)
        result = run(log, METHODS["full"])
        ratios = {table.robot: turned(result, table) for table in log.tables if table.is_odometry}
        with bearing_scales():
            scales = scales_of(run(log, METHODS["full"]))
        for robot, shares in ratios.items():
            cells = " | ".join("" if np.isnan(share) else f"{share:.2f}" for share in shares)
            scale = " | ".join(scales.get((robot, source), "") for source in ("landmarks", "robots"))
            page = told(page, f"| {path.name}, {robot} | {cells} | {scale} |\n")
        if path == asked.logs[0]:
            left_right: Ratios = {robot: (left, right) for robot, (_, left, right) in ratios.items()}
    path = asked.logs[0]
    page = told(page, MAPS.format(log=path.name))
    with tempfile.TemporaryDirectory() as folder:
        right = read(commands_put_right(path, Path(folder) / path.name, left_right))
        as_it_is = read(path)
        ways = {
            "as it is": (as_it_is, False),
            "turns": (right, False),
            "bearings": (as_it_is, True),
            "both": (right, True),
        }
        for name, (log, scaled) in ways.items():
            with bearing_scales(scaled):
                page = told(page, f"| {name} | {map_of(log)} |\n")
    if asked.out:
        asked.out.write_text(page)


def told(page: str, line: str) -> str:
    """The page with a line more, which is shown."""
    print(line, end="", flush=True)
    return page + line


def turned(result: Result, table: Table) -> tuple[float, float, float]:
    """Over what a robot was told to turn, how far it did by the map: on the spot, to its left and to its right."""
    way, keys, names = result.map.all_values, table.keys, result.map.names
    inside = way.layout.contains(keys).all(-1)
    keys, values = keys[inside], table.values[inside]
    stamps = names.stamps_s(keys)
    lasting = stamps[:, 1] - stamps[:, 0]
    told, done = _motion(pose_of(values, 2)), _motion(way.poses_of(keys[:, 0], 2).between(way.poses_of(keys[:, 1], 2)))
    speed, turn = np.hypot(told[:, 0], told[:, 1]) / lasting, told[:, 2] / lasting
    turning, under_way = np.abs(turn) > TURNING, speed > UNDER_WAY * usual(speed)
    parts = (turning & (speed < SPOT), turning & under_way & (turn > 0), turning & under_way & (turn < 0))
    spot, left, right = (
        float(done[part, 2].sum() / told[part, 2].sum()) if part.sum() >= FEWEST else float("nan") for part in parts
    )
    return spot, left, right


def usual(speed: Array) -> float:
    """The speed of a robot that moves, in the middle."""
    return float(np.median(speed[speed > SPOT]))


def _motion(pose: Pose) -> Array:
    return pose.minus(Pose.identity(2, pose.batch))


@contextmanager
def bearing_scales(let_in: bool = True) -> Iterator[None]:
    """With the scale of bearings among the systematic errors that there may be."""
    before = terms.TERMS
    if let_in:
        terms.TERMS = (*before, terms.Term("bearing scale", "", _wider, lambda scene: terms.SHARE))
    try:
        yield
    finally:
        terms.TERMS = before


def _wider(scene: terms.Scene) -> Array | None:
    if not scene.sees or scene.table.model != "range_bearing" or scene.table.dim != 2:
        return None
    out = np.zeros((len(scene.table), 2))
    out[:, 1] = scene.predicted[:, 1]
    return out


def scales_of(result: Result) -> dict[tuple[int, str], str]:
    """The bearing scales that were chosen, by robot and source."""
    found = result.calibration.systematic if result.calibration else ()
    return {(e.robot, e.source): f"{e.value:+.3f} +- {e.sigma:.3f}" for e in found if e.term == "bearing scale"}


def commands_put_right(log: Path, folder: Path, shares: Ratios) -> Path:
    """A copy of a log whose commands to turn under way are these shares (left, right) of what they are."""
    shutil.copytree(log, folder)
    for robot, (left, right) in shares.items():
        path = folder / f"Robot{robot}_Odometry.dat"
        rows = np.loadtxt(path)
        share = np.where(rows[:, 2] > 0, left, right)
        rows[:, 2] *= np.where(rows[:, 1] > UNDER_WAY * usual(rows[:, 1]), share, 1.0)
        np.savetxt(path, rows, fmt="%.9f")
    return folder


def map_of(log: Dataset) -> str:
    """The cells of one way to map a log."""
    landmarks, _, _, each, *_, rmse = numbers(run(log, METHODS["full"]))
    cells = f"{landmarks:.2f} | {each:.2f} | {rmse:.4f}"
    assert log.truth is not None
    for halves in (by_robots(), by_time(log)):
        one, other = (Half.of(log.with_tables(cut(log, rows))) for rows in halves)
        apart, _, common, off = compared(one, other, log.truth).split(" | ")
        cells += f" | {apart} | {common} | {off}"
    return cells


if __name__ == "__main__":
    main()
