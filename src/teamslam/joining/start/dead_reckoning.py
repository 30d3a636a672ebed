"""A robot's way by its own relative poses alone.

Along the odometry the poses compose, X_t = X_{t-1} @ O_t, by prefix products (log n batched steps). Where a pose is not
linked to the next, others link it, such as loop closures: then `chordal` finds them all at once.
"""

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import IntArray, Pose, compose_along
from teamslam.joining.start.chordal import chordal
from teamslam.joining.start.odometry import odometry_links, own_rows
from teamslam.joining.start.targets import measured_poses
from teamslam.model import Dataset, Table, Values, pose_kind, robot_of
from teamslam.model.sparse import sp


def dead_reckoning(piece: Dataset, robot: int) -> Values:
    """The robot's poses from its relative poses, in the frame of its first pose (which is among them, the identity).

    Raises ModelError where they do not hang together.
    """
    poses = own_chain(piece, robot)
    dim = piece.robots[robot]
    which, row, backward = odometry_links(piece, robot, poses)
    if (which < 0).any():
        return Values.of({pose_kind(dim): (poses, chordal(own_rows(piece, robot), poses, dim))})
    return Values.of({pose_kind(dim): (poses, compose_along(steps_along(piece, dim, which, row, backward)))})


def steps_along(piece: Dataset, dim: int, which: IntArray, row: IntArray, backward: IntArray) -> Pose:
    """The steps (n,) of a chain whose links `odometry_links` gives; no motion where nothing links two poses."""
    rotation, translation = np.tile(np.eye(dim), (len(which), 1, 1)), np.zeros((len(which), dim))
    for number in np.unique(which[which >= 0]).tolist():
        steps = np.flatnonzero(which == number)
        measured = measured_poses(piece.tables[number].select(row[steps]), dim)
        back = backward[steps] == 1
        inverse = measured.inverse()
        rotation[steps] = np.where(back[:, None, None], inverse.rotation, measured.rotation)
        translation[steps] = np.where(back[:, None], inverse.translation, measured.translation)
    return Pose(rotation, translation)


def own_chain(piece: Dataset, robot: int) -> IntArray:
    """The robot's poses that its relative poses link to the first one, in time order.

    As far as each pose is linked to the next, that is the chain, and poses beyond its end may only be targets (of loop
    closures into another piece); in a graph that runs otherwise, all that hang together. Raises ModelError where an
    observer hangs on nothing.
    """
    poses = piece.pose_keys[robot]
    which, _, _ = odometry_links(piece, robot, poses)
    gaps = np.flatnonzero(which < 0)
    if not len(gaps):
        return poses
    from scipy.sparse.csgraph import connected_components

    chain = poses[: gaps[0] + 1]
    observers = np.concatenate([_earlier(table, robot) for table in piece.tables])
    observers = observers[robot_of(observers) == robot]
    if observers.max() <= chain[-1]:
        return np.asarray(chain)
    pairs = np.searchsorted(poses, np.concatenate([t.keys for t in own_rows(piece, robot)] or [np.zeros((0, 2), int)]))
    graph = sp.csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(poses), len(poses)))
    _, labels = connected_components(graph, directed=False)
    chain = poses[labels == labels[0]]
    if lost := observers[~np.isin(observers, chain)].tolist():
        raise ModelError(
            f"no odometry links {piece.names.describe(lost[0])} to {piece.names.describe(int(poses[0]))}: this is not "
            f"one piece; teamslam.split cuts a log there"
        )
    return np.asarray(chain)


def _earlier(table: Table, robot: int) -> IntArray:
    """The pose that each row belongs to: its observer, or the earlier of two of the robot's own poses."""
    return np.asarray(np.where((robot_of(table.keys) == robot).all(1), table.keys.min(1), table.keys[:, 0]))
