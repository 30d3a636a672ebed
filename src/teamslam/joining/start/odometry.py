"""A robot's chain of odometry: which row links each pose to the next, and how far the heading may be lost along it."""

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Dataset, Table, among, robot_of, variances


def own_rows(log: Dataset, robot: int) -> list[Table]:
    """The relative poses between two of the robot's own poses: odometry and loop closures."""
    own = [t.select((robot_of(t.keys) == robot).all(1)) for t in log.tables if t.model == "relative_pose"]
    return [table for table in own if len(table)]


def odometry_links(log: Dataset, robot: int, poses: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """For each consecutive pair of a robot's poses, the table and row of a relative pose between them, or -1: two
    arrays (n - 1,); and 1 where the row runs backwards in time."""
    n = max(len(poses) - 1, 0)
    which, row, backward = np.full(n, -1), np.full(n, -1), np.zeros(n, np.int64)
    for number, table in enumerate(log.tables):
        if table.model != "relative_pose":
            continue
        own = (robot_of(table.keys) == robot).all(1) & among(table.keys, poses).all(1)
        at = np.full(table.keys.shape, -5)
        at[own] = np.searchsorted(poses, table.keys[own])
        for step, back in ((1, 0), (-1, 1)):
            found = np.flatnonzero(own & (at[:, 1] - at[:, 0] == step))
            pair = at[found].min(1)
            fresh = which[pair] < 0
            pair, first = np.unique(pair[fresh], return_index=True)
            which[pair], row[pair], backward[pair] = number, found[fresh][first], back
    return which, row, backward


def heading_variances(log: Dataset, robot: int, poses: IntArray) -> Array:
    """The variance of the heading that each odometry step adds (n - 1,) [rad^2], in space the sum over its axes;
    infinite where no odometry tells it."""
    return _variances(log, robot, poses, turns=True)


def length_variances(log: Dataset, robot: int, poses: IntArray) -> Array:
    """The variance of the place that each odometry step adds (n - 1,) [m^2], the sum over its axes; infinite where no
    odometry tells it."""
    return _variances(log, robot, poses, turns=False)


def _variances(log: Dataset, robot: int, poses: IntArray, *, turns: bool) -> Array:
    which, row, _ = odometry_links(log, robot, poses)
    variance = np.full(len(which), np.inf)
    for number in np.unique(which[which >= 0]).tolist():
        steps, table = np.flatnonzero(which == number), log.tables[number]
        found = variances(table.whitening)
        each = (found[:, table.dim :] if turns else found[:, : table.dim]).sum(-1)
        variance[steps] = np.broadcast_to(each, len(table))[row[steps]]
    return variance
