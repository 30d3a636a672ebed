"""Fewer sightings of robots: only those from keyframes.

Every sighting of a robot makes two poses separators, one of each robot, and separators are what a message pays for.
Their worth falls while their cost does not: seen again a moment later from nearly the same place, a robot tells little
that odometry has not. What is left out is counted, and is then in no map.
"""

import math
from dataclasses import replace

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import BoolArray
from teamslam.model import Dataset, Dropped, Table, index_of, is_pose, robot_of


def keyframe(dataset: Dataset, *, every: int | None = None, min_interval_s: float | None = None) -> Dataset:
    """The dataset with fewer sightings of robots, and the number left out among its `dropped`.

    `every`: of each pair of robots the first sighting and then each n-th. `min_interval_s` [s]: of each pair the first,
    and then those at least so long after the last one kept. Raises InputError unless exactly one of the two is given.
    """
    if (every is None) == (min_interval_s is None):
        raise InputError("give either every (a count) or min_interval_s (seconds), and not both")
    if every is not None and every < 1:
        raise InputError(f"of the sightings of robots one in {every} cannot be kept; 1 keeps all, 50 every fiftieth")
    if min_interval_s is not None and not min_interval_s >= 0.0:
        raise InputError(f"sightings of robots cannot be {min_interval_s:g} s apart; 0 keeps all, 10 one in 10 s")
    ticks = 0 if min_interval_s is None else math.ceil(min_interval_s / dataset.names.tick_s - 1e-6)
    tables, dropped = [], 0
    for table in dataset.tables:
        keep = _kept(table, every, ticks)
        dropped += int((~keep).sum())
        tables.append(table if keep.all() else table.select(keep))
    if not dropped:
        return dataset
    rule = f"one in {every}" if every is not None else f"one every {min_interval_s:g} s"
    reason = f"sightings of robots between keyframes ({rule} of each pair is kept)"
    thinned = dataset.with_tables(t for t in tables if len(t))
    return replace(thinned, dropped=(*dataset.dropped, Dropped(dropped, reason)))


def _kept(table: Table, every: int | None, ticks: int) -> BoolArray:
    keep = np.ones(len(table), bool)
    if table.row.unary:
        return keep
    observer, target = table.keys[:, 0], table.keys[:, 1]
    seen = robot_of(target)
    of_robots = is_pose(target) & (seen != robot_of(observer))
    for robot in np.unique(seen[of_robots]).tolist():
        rows = np.flatnonzero(of_robots & (seen == robot))
        rows = rows[np.argsort(observer[rows], kind="stable")]
        keep[rows] = False
        if every is not None:
            keep[rows[::every]] = True
            continue
        times = index_of(observer[rows])
        last = None
        for row, time in zip(rows.tolist(), times.tolist(), strict=True):
            if last is None or time - last >= ticks:
                keep[row], last = True, time
    return keep
