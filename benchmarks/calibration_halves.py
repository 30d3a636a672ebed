"""Whose errors are what calibrated landmarks are still off by: the truth's, or those of the robots that saw them.

    python benchmarks/calibration_halves.py MRCLAM_Dataset9 MRCLAM_Dataset6 --out docs/benchmarks/calibration_halves.md
    python benchmarks/calibration_halves.py MRCLAM_Dataset1 --unmoved MRCLAM_Dataset6 MRCLAM_Dataset7

Two halves of a log, by time (all robots) and by robots (the odd and the even), each mapped alone: full least squares,
calibrated; and two whole logs among landmarks that nobody moved in between (by the survey of each, MRCLAM 6 and 7 are
such: within 1.1 mm). With e1, e2 the errors of landmarks, C1, C2 their covariances, and M = (C1 + C2)^-1 without what a
motion of the whole does,

    apart      (e1 - e2)' M (e1 - e2) / tr M (C1 + C2)        1 where both halves know what they claim
    to truth   e' M e / tr M C                                of each half
    common     e1' M e2 / (tr M C1 M C2)^1/2                  deviations: 0 +- 1 where errors have nothing in common
    5 mm       what `common` would be if the truth were off by 5 mm in each coordinate

What is the truth's own error is in common to both halves, however the log is cut. What a robot errs by from first to
last is in common to halves by time, and not to halves by robots.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from teamslam.config import Config
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io import read
from teamslam.model import Dataset, Table, Values, is_landmark, is_pose, robot_of
from teamslam.pipeline import run
from teamslam.solver import Covariances

OFF_M = 0.005
HEAD = """# Whose errors landmarks are still off by

Written by `{command}`.

```text
{what}
```

| log, halves by | apart | to truth | common | 5 mm |
|---|---|---|---|---|
"""
Rows = Callable[[Table], BoolArray]


def main() -> None:
    """Cut, map, compare and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--unmoved", type=Path, nargs=2, default=())
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    command = "python benchmarks/calibration_halves.py " + " ".join(log.name for log in asked.logs)
    if asked.unmoved:
        command += " --unmoved " + " ".join(log.name for log in asked.unmoved)
    page = HEAD.format(command=command, what=(__doc__ or "").strip().split("\n\n", 2)[2])
    print(page, end="")
    for path in asked.logs:
        log = read(path)
        for name, halves in (("time", by_time(log)), ("robots", by_robots())):
            one, other = (Half.of(log.with_tables(cut(log, rows))) for rows in halves)
            assert log.truth is not None
            line = f"| {path.name}, {name} | {compared(one, other, log.truth)} |"
            print(line, flush=True)
            page += line + "\n"
    if asked.unmoved:
        logs = [read(path) for path in asked.unmoved]
        truth = logs[0].truth
        assert truth is not None
        one, other = map(Half.of, logs)
        line = f"| {' and '.join(path.name for path in asked.unmoved)} | {compared(one, other, truth)} |"
        print(line)
        page += line + "\n"
    if asked.out:
        asked.out.write_text(page)


@dataclass(frozen=True, eq=False)
class Half:
    """The landmarks of a map (n,) by rising keys, their places (n, 2) and joint covariance (2n, 2n)."""

    keys: IntArray
    places: Array
    covariance: Array

    @classmethod
    def of(cls, log: Dataset) -> "Half":
        """Those of the largest map of a log."""
        map = max(run(log, Config(method="full")).maps, key=lambda map: map.dof)
        keys = map.values.layout.keys[is_landmark(map.values.layout.keys)]
        return cls(keys, map.all_values.positions(keys, 2), Covariances.of_map(map).joint(keys))

    def beside(self, truth: Values, keys: IntArray) -> tuple[Array, Array]:
        """Errors (2n,) of some landmarks and their covariance, turned and shifted to the truth."""
        at = np.searchsorted(self.keys, keys)
        numbers = (2 * at[:, None] + np.arange(2)).ravel()
        places, true = self.places[at], truth.positions(keys, 2)
        places, true = places - places.mean(0), true - true.mean(0)
        angle = np.arctan2(np.sum(places[:, 0] * true[:, 1] - places[:, 1] * true[:, 0]), np.sum(places * true))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        turns = np.kron(np.eye(len(keys)), turn)
        return (places @ turn.T - true).ravel(), turns @ self.covariance[np.ix_(numbers, numbers)] @ turns.T


def compared(one: Half, other: Half, truth: Values) -> str:
    """The cells of two halves."""
    keys = np.intersect1d(one.keys, other.keys)
    (e1, c1), (e2, c2) = (half.beside(truth, keys) for half in (one, other))
    true = truth.positions(keys, 2) - truth.positions(keys, 2).mean(0)
    swung = np.stack([-true[:, 1], true[:, 0]], -1).reshape(-1, 1)
    motions = np.concatenate([np.tile(np.eye(2), (len(keys), 1)), swung], 1)
    weight = np.linalg.inv(c1 + c2)
    metric = weight - weight @ motions @ np.linalg.solve(motions.T @ weight @ motions, motions.T @ weight)
    apart, each = _size(e1 - e2, metric, c1 + c2), [_size(e, metric, c) for e, c in ((e1, c1), (e2, c2))]
    deviation = np.sqrt(np.trace(metric @ c1 @ metric @ c2))
    common, off = e1 @ metric @ e2 / deviation, OFF_M**2 * np.trace(metric) / deviation
    return f"{apart:.2f} | {each[0]:.2f}, {each[1]:.2f} | {common:+.1f} | {off:+.1f}"


def by_time(log: Dataset) -> tuple[Rows, Rows]:
    """Rows before and after the middle one; none of both."""
    stamps = log.names.stamps_s
    middle = float(np.median(np.concatenate([stamps(table.keys[:, 0]) for table in log.tables])))

    def ends(table: Table) -> Array:
        return np.where(is_pose(table.keys), stamps(table.keys), stamps(table.keys[:, :1]))

    return lambda table: ends(table).max(1) < middle, lambda table: ends(table).min(1) >= middle


def by_robots() -> tuple[Rows, Rows]:
    """Rows of odd robots, and of even ones, that are about none of the others."""

    def among(table: Table, odd: int) -> BoolArray:
        target = table.keys[:, -1]
        return np.asarray((table.robot % 2 == odd) & (~is_pose(target) | (robot_of(target) % 2 == odd)))

    return lambda table: among(table, 1), lambda table: among(table, 0)


def cut(log: Dataset, rows: Rows) -> Iterator[Table]:
    """The tables of some rows."""
    for table in log.tables:
        part = table.select(np.flatnonzero(rows(table)))
        if len(part):
            yield part


def _size(error: Array, metric: Array, covariance: Array) -> float:
    return float(error @ metric @ error / np.trace(metric @ covariance))


if __name__ == "__main__":
    main()
