"""Cutting a log into pieces, each of which becomes a submap.

A piece is a stretch of one robot's way. Every measurement goes into exactly one piece (that of the pose it was taken
from), and consecutive pieces share their boundary pose: the last of one is the first of the next. Where no relative
poses hold what comes after to what was before (odometry is missing, and no loop closes around the gap), the log is
always cut, without a shared pose. Otherwise a robot's log is one piece, as in the
paper, unless pieces of a certain length are asked for: in poses, or in how far the heading may be lost along a piece
by dead reckoning.

    cuts       where pieces end by their length, and, for a log that still grows, which of these are settled
    stretches  the rows between the cuts
    apart      a stretch, cut again where its relative poses do not hang together

A cut depends on what was before it and on a few poses after it, and the count begins anew at each: so a log may be cut
while it grows, and ends in the same pieces.
"""

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray
from teamslam.joining.start.odometry import heading_variances
from teamslam.model import A_LOG, Dataset, Names, Table, expect, is_pose, robot_of
from teamslam.model.sparse import sp

MIN_POSES = 10  # pieces cut by heading are not shorter: they would cost more to join than they save


def split(dataset: Dataset, *, poses_per_piece: int | None = None, heading_sigma: float | None = None) -> list[Dataset]:
    """The pieces of a log, robot by robot and in time order.

    `poses_per_piece` cuts by count; `heading_sigma` [rad] where the standard deviation of the dead-reckoned heading,
    summed along the odometry, reaches it. Law: the pieces' tables together hold every row of the dataset's tables
    once. Raises ModelError where a row in a robot's table was taken from another robot's pose.
    """
    expect(dataset, Dataset, A_LOG)
    return [
        piece
        for robot in sorted(dataset.robots)
        for piece in _split_robot(dataset.of_robot(robot), robot, poses_per_piece, heading_sigma)
    ]


def _split_robot(log: Dataset, robot: int, poses_per_piece: int | None, heading_sigma: float | None) -> list[Dataset]:
    if not log.tables:
        return []
    for table in log.tables:
        refuse_borrowed(table, log.names)
    starts = cuts(log, robot, poses_per_piece=poses_per_piece, heading_sigma=heading_sigma)
    return [piece for stretch in stretches(log, starts) for piece in apart(stretch, robot)]


def cuts(
    log: Dataset,
    robot: int,
    *,
    since: int | None = None,
    until: int | None = None,
    poses_per_piece: int | None = None,
    heading_sigma: float | None = None,
) -> IntArray:
    """The poses at which one robot's log is cut by length, rising: each ends a stretch and begins the next.

    `since`: the pose at which a longer log was cut before these rows. `until`: only cuts at poses before this one.
    Law: where all is known of the poses before `until`, these cuts and those of the rest since the last of them are the
    cuts of the whole.
    """
    poses = log.pose_keys[robot]
    if since is not None:
        poses = np.union1d(poses[poses >= since], [since])
    return cuts_along(poses, log, robot, until=until, poses_per_piece=poses_per_piece, heading_sigma=heading_sigma)


def cuts_along(
    poses: IntArray,
    odometry: Dataset,
    robot: int,
    *,
    until: int | None = None,
    poses_per_piece: int | None = None,
    heading_sigma: float | None = None,
) -> IntArray:
    """The same along a robot's poses, rising, the first of which begins a stretch; of the log only the odometry counts,
    and that only where a piece ends by its heading."""
    counted = heading_sigma is None
    variance = np.zeros(max(len(poses) - 1, 0)) if counted else heading_variances(odometry, robot, poses)
    found = poses[_cuts(variance, poses_per_piece, heading_sigma)[1:]]
    return np.asarray(found if until is None else found[found < until])


def stretches(log: Dataset, ends: IntArray) -> list[Dataset]:
    """The rows of one robot's log in parts, one more than there are cuts at poses `ends`; empty ones are left out."""
    part_of_row = [np.searchsorted(ends, taken_from(table), side="right") for table in log.tables]
    parts = (
        log.with_tables(
            t.select(rows == n) for t, rows in zip(log.tables, part_of_row, strict=True) if (rows == n).any()
        )
        for n in range(len(ends) + 1)
    )
    return [part for part in parts if part.tables]


def refuse_borrowed(table: Table, names: Names) -> None:
    """Raise ModelError where a row in a robot's table was taken from another robot's pose."""
    own = table.own.any(1)
    if table.row.unary or own.all():
        return
    row = int(np.flatnonzero(~own)[0])
    raise ModelError(
        f"row {int(table.ids[row])} of the {table.source} of robot {names.robot(table.robot)} was taken from "
        f"{names.describe(int(table.keys[row, 0]))}; a submap is built from what a robot saw from its own poses: put "
        f"the row into a table of the robot that saw it"
    )


def _cuts(variance: Array, poses_per_piece: int | None, heading_sigma: float | None) -> IntArray:
    """Where pieces start by their length, as places in the list of poses."""
    starts, last = [0], len(variance)
    if not poses_per_piece and heading_sigma is None:
        return np.array(starts)
    since, count = 0.0, 1
    for step, more in enumerate(np.where(np.isfinite(variance), variance, 0.0).tolist()):
        since, count = since + more, count + 1
        full = bool(poses_per_piece and count > poses_per_piece)
        full |= heading_sigma is not None and count > MIN_POSES and since > heading_sigma**2
        remaining = last - (step + 1)
        if full and remaining >= (1 if poses_per_piece else MIN_POSES // 2):
            starts.append(step + 1)
            since, count = 0.0, 1
    return np.array(starts)


def taken_from(table: Table) -> IntArray:
    """The pose (m,) that each row was taken from: of a row between two of the robot's own, the earlier. What was not
    taken from a pose (a landmark that was surveyed) has -1: it goes with the robot's first."""
    own = table.own.all(1)
    at = np.where(own, table.keys.min(1), table.keys[:, 0])
    return np.where(is_pose(at), at, -1)


def apart(stretch: Dataset, robot: int) -> list[Dataset]:
    """The parts of a stretch, in time order, that the robot's relative poses hold together."""
    poses = stretch.pose_keys[robot]
    if not len(poses) or np.isfinite(heading_variances(stretch, robot, poses)).all():
        return [stretch]
    from scipy.sparse.csgraph import connected_components

    stands, links = [], [np.zeros((0, 2), np.int64)]
    for table in stretch.tables:
        stands.append(np.searchsorted(poses, np.maximum(taken_from(table), poses[0])))
        if table.model == "relative_pose":
            links.append(np.searchsorted(poses, table.keys[(robot_of(table.keys) == table.robot).all(1)]))
    i, j = np.concatenate(links).T
    _, group = connected_components(sp.coo_array((np.ones(len(i)), (i, j)), shape=(len(poses),) * 2), directed=False)
    _, first, label = np.unique(group, return_index=True, return_inverse=True)
    in_time: IntArray = np.argsort(np.argsort(first))[label]
    parts = (
        stretch.with_tables(
            t.select(part) for t, at in zip(stretch.tables, stands, strict=True) if (part := in_time[at] == n).any()
        )
        for n in range(len(first))
    )
    return [part for part in parts if part.tables]
