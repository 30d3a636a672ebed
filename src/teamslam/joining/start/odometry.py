"""A robot's chain of odometry: which row links each pose to the next, and how far the heading may be lost along it."""

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import Dataset, robot_of, variances


def odometry_links(log: Dataset, robot: int, poses: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """For each consecutive pair of a robot's poses, the table and row of a relative pose between them, or -1: two
    arrays (n - 1,); and 1 where the row runs backwards in time."""
    n = max(len(poses) - 1, 0)
    which, row, backward = np.full(n, -1), np.full(n, -1), np.zeros(n, np.int64)
    for number, table in enumerate(log.tables):
        if table.model != "relative_pose":
            continue
        own = (robot_of(table.keys) == robot).all(1)
        at = np.full(table.keys.shape, -5)
        at[own] = np.searchsorted(poses, table.keys[own])
        for step, back in ((1, 0), (-1, 1)):
            found = np.flatnonzero(own & (at[:, 1] - at[:, 0] == step))
            pair = at[found].min(1)
            fresh = which[pair] < 0
            pair, first = np.unique(pair[fresh], return_index=True)
            which[pair], row[pair], backward[pair] = number, found[fresh][first], back
    return which, row, backward


def odometry_along(log: Dataset, robot: int, poses: IntArray) -> tuple[Array, BoolArray]:
    """The variance of the heading that each odometry step adds (n - 1,), and where one pose hangs on the next at all:
    by that step, or by a relative pose that reaches across."""
    which, row, _ = odometry_links(log, robot, poses)
    variance = np.zeros(len(which))
    for number, table in enumerate(log.tables):
        steps = np.flatnonzero(which == number)
        if len(steps):
            whitening = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))[row[steps]]
            variance[steps] = variances(whitening)[:, table.dim :].sum(-1)
    return variance, (which >= 0) | _reached_across(log, robot, poses)


def _reached_across(log: Dataset, robot: int, poses: IntArray) -> BoolArray:
    """Where (n - 1,) a relative pose between two of the robot's own poses reaches from before to after."""
    begin_end = np.zeros(len(poses) + 1, np.int64)
    for table in log.tables:
        if table.model == "relative_pose":
            own = np.searchsorted(poses, table.keys[(robot_of(table.keys) == robot).all(1)])
            np.add.at(begin_end, own.min(1), 1)
            np.add.at(begin_end, own.max(1), -1)
    return np.asarray(np.cumsum(begin_end)[: max(len(poses) - 1, 0)] > 0)
