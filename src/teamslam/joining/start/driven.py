"""A start for a log of which another start makes no sense: the map as it grows while the robot drives.

    for each of PARTS parts of the way:
        append: its poses hang on the last estimate by odometry, and what is seen first from there is placed from there
        solve:  all rows so far, a few steps

So a loop is closed when it is first seen, by what was lost along it, and not by what the whole way lost. That is what
an incremental solver does (Kaess et al., iSAM, IEEE T-RO 2008), with PARTS solves, however long the way: on average of
half the rows, of a few steps each (`settled`).
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import IntArray, Pose
from teamslam.joining.start.targets import place_targets
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import Layout, Table, Values, pose_kind
from teamslam.solver import settled

PARTS = 20


def driven(tables: Sequence[Table], way: Values, kinds: Layout, dim: int) -> Values:
    """The way of a robot, and all that `tables` fix along it, part by part.

    `way` has every pose by dead reckoning, the first of which is the frame; `kinds` are those of the variables in the
    robot's own frame, and `dim` is the robot's. What cannot be solved stays where it was put. A target of which only
    the place is known so far, and later how it is turned, waits until then.
    """
    keys = way.layout.keys
    reckoned = way.poses_of(keys, dim)
    ends = np.unique(np.linspace(0, len(keys), PARTS + 1).round().astype(int)[1:])
    latest = [_latest(table, keys) for table in tables]
    values, begin = way.only(keys[:1]), 1
    for end in ends[ends > 1].tolist():
        values = values.update(_appended(values, keys, reckoned, begin, end, dim))
        known = [t.select(at < end) for t, at in zip(tables, latest, strict=True) if (at < end).any()]
        seen = triangulate(place_targets(values, known, kinds), known)
        values = settled(seen.select(seen.layout.kinds == kinds.kinds[kinds.index(seen.layout.keys)]), known, keys[:1])
        begin = end
    return values


def _latest(table: Table, keys: IntArray) -> IntArray:
    """The place along the way of the last pose that each row names."""
    at = np.minimum(np.searchsorted(keys, table.keys), len(keys) - 1)
    latest: IntArray = np.where(keys[at] == table.keys, at, 0).max(1)
    return latest


def _appended(values: Values, keys: IntArray, reckoned: Pose, begin: int, end: int, dim: int) -> Values:
    """The poses of a part, hanging on the last one before it."""
    last = values.poses_of(keys[begin - 1 : begin], dim)[0]
    return Values.of({pose_kind(dim): (keys[begin:end], last @ reckoned[begin - 1].between(reckoned[begin:end]))})
