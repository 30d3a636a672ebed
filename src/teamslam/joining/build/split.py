"""Cutting a log into pieces, each of which becomes a submap.

A piece is a stretch of one robot's way. Every measurement goes into exactly one piece (that of the pose it was taken
from), and consecutive pieces share their boundary pose: the last of one is the base of the next. Where no relative
poses hold what comes after to what was before (odometry is missing, and no loop closes around the gap), the log is
always cut, without a shared pose. Otherwise a robot's log is one piece, as in the
paper, unless pieces of a certain length are asked for: in poses, or in how far the heading may be lost along a piece
by dead reckoning.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray
from teamslam.joining.start.odometry import heading_variances
from teamslam.model import Dataset, Names, Table, is_pose, robot_of

MIN_POSES = 10  # pieces cut by heading are not shorter: they would cost more to join than they save


def split(dataset: Dataset, *, poses_per_piece: int | None = None, heading_sigma: float | None = None) -> list[Dataset]:
    """The pieces of a log, robot by robot and in time order.

    `poses_per_piece` cuts by count; `heading_sigma` [rad] where the standard deviation of the dead-reckoned heading,
    summed along the odometry, reaches it. Law: the pieces' tables together hold every row of the dataset's tables
    once. Raises ModelError where a row in a robot's table was taken from another robot's pose.
    """
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
    poses = log.pose_keys[robot]
    variance = heading_variances(log, robot, poses)
    starts = _cuts(variance, poses_per_piece, heading_sigma)
    piece_of_row = [_piece_of(table, poses[starts]) for table in log.tables]
    if not np.isfinite(variance).all():
        piece_of_row = _hanging_together(log, piece_of_row, poses)
    pieces = []
    for number in range(1 + max(int(rows.max(initial=0)) for rows in piece_of_row)):
        tables = (t.select(rows == number) for t, rows in zip(log.tables, piece_of_row, strict=True))
        pieces.append(log.with_tables(t for t in tables if len(t)))
    return [piece for piece in pieces if piece.tables]


def refuse_borrowed(table: Table, names: Names) -> None:
    """Raise ModelError where a row in a robot's table was taken from another robot's pose."""
    own = (robot_of(table.keys) == table.robot).any(1)
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


def _piece_of(table: Table, first_poses: IntArray) -> IntArray:
    """The piece that each row belongs to: the last one that starts at or before the pose it was taken from; of a row
    between two of the robot's own poses, the earlier counts."""
    place = np.searchsorted(first_poses, _taken_from(table), side="right") - 1
    return np.where(is_pose(_taken_from(table)), np.maximum(place, 0), 0)


def _taken_from(table: Table) -> IntArray:
    own = (robot_of(table.keys) == table.robot).all(1)
    return np.where(own, table.keys.min(1), table.keys[:, 0])


def _hanging_together(log: Dataset, piece_of_row: Sequence[IntArray], poses: IntArray) -> list[IntArray]:
    """The pieces that rows belong to once those are cut apart whose relative poses do not hang together."""
    from scipy.sparse.csgraph import connected_components

    n = len(poses)
    stands, links = [], [np.zeros((0, 2), np.int64)]
    for table, piece in zip(log.tables, piece_of_row, strict=True):
        at = _taken_from(table)
        stands.append(piece * n + np.where(is_pose(at), np.searchsorted(poses, at), 0))
        if table.model == "relative_pose":
            own = (robot_of(table.keys) == table.robot).all(1)
            links.append(piece[own, None] * n + np.searchsorted(poses, table.keys[own]))
    ends = np.concatenate(links)
    nodes = np.unique(np.concatenate([*stands, ends.ravel()]))
    i, j = np.searchsorted(nodes, ends).T
    _, group = connected_components(sp.coo_array((np.ones(len(i)), (i, j)), shape=(len(nodes),) * 2), directed=False)
    _, first, label = np.unique(group, return_index=True, return_inverse=True)
    in_time: IntArray = np.argsort(np.argsort(first))[label]
    return [in_time[np.searchsorted(nodes, stand)] for stand in stands]
