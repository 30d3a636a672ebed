"""Poses by agreement: where others saw a robot at a time when it has no pose, its odometry is cut there.

Who saw it names the time; the robot itself knows how it moved. An increment that leads over that time becomes two, as
`keyframes` cuts increments, and both keep the number of the row they come from: it is one measurement still.
"""

from dataclasses import replace

import numpy as np

from teamslam.frontend.keyframes import cut_at, is_increment
from teamslam.geometry import BoolArray, IntArray
from teamslam.model import Dataset, Table, index_of, robot_of


def with_poses(log: Dataset, robot: int, keys: IntArray) -> Dataset:
    """One robot's log, or a piece of it, with a pose at each of some of its `keys` (m,) where an increment of its
    odometry leads from the pose before to the pose after; the log itself where there is none.

    Laws: the order and repetition of keys change nothing; what is a pose already, or in a hole, or outside, neither.
    """
    poses = log.pose_keys[robot]
    fresh = np.setdiff1d(keys[robot_of(keys) == robot], poses)
    tables = [_cut(table, poses, fresh) if is_increment(table) else table for table in log.tables]
    same = all(cut is table for cut, table in zip(tables, log.tables, strict=True))
    return log if same else log.with_tables(tables)


def _cut(table: Table, poses: IntArray, fresh: IntArray) -> Table:
    """A table of increments with those cut that lead from one of the poses to the next."""
    onward = _neighbours(table, poses)
    if not onward.any():
        return table
    steps = table.select(onward)
    cut = cut_at(steps, index_of(fresh))
    if cut is steps:
        return table
    return cut if onward.all() else _both(cut, table.select(~onward))


def _neighbours(table: Table, poses: IntArray) -> BoolArray:
    """Which rows lead from a pose to the next; of several between two poses, the first."""
    at = np.searchsorted(poses, table.keys)
    onward = at[:, 1] == at[:, 0] + 1
    _, first = np.unique(at[:, 0] + len(poses) * ~onward, return_index=True)
    return np.asarray(onward & np.isin(np.arange(len(table)), first))


def _both(one: Table, other: Table) -> Table:
    """The rows of two tables of one channel."""
    W = np.broadcast_to(other.whitening, (len(other), *other.whitening.shape[1:]))
    return replace(
        one,
        keys=np.concatenate([one.keys, other.keys]),
        values=np.concatenate([one.values, other.values]),
        whitening=np.concatenate([one.whitening, W]),
        ids=np.concatenate([one.ids, other.ids]),
    )
