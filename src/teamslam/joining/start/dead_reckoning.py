"""Start values of a piece: dead reckoning from its base, and every target where it was first seen whole.

Along the odometry the poses compose, X_t = X_{t-1} @ O_t, by prefix products (log n batched steps). A target is placed
by the first sighting that fixes all of it: a pose by a relative pose, a point by a point or a range with bearing.
"""

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp

from teamslam.errors import ModelError
from teamslam.geometry import Array, BoolArray, IntArray, Pose, concatenate, lift_points
from teamslam.joining.start.odometry import odometry_links
from teamslam.model import Dataset, Kind, Layout, Table, Values, pose_kind, robot_of, unpack

WHOLE = ("point", "range_bearing")  # models that fix a position at once


def dead_reckoning(piece: Dataset, robot: int) -> Values:
    """The robot's poses from odometry alone, in the frame of its first pose (which is among them, the identity).

    Raises ModelError where the chain of odometry is broken.
    """
    poses = own_chain(piece, robot)
    dim = piece.robots[robot]
    which, row, backward = odometry_links(piece, robot, poses)
    if (which < 0).any():
        return Values.of({pose_kind(dim): (poses, _compose_by_tree(piece, robot, poses))})
    steps = Pose.identity(dim, (len(which),))
    for number, table in enumerate(piece.tables):
        mask = which == number
        if mask.any():
            measured = _planar_or_whole(_of_bodies(table, unpack_poses(table)), dim)[row[mask]]
            measured = _choose(backward[mask] == 1, measured.inverse(), measured)
            rotation, translation = steps.rotation.copy(), steps.translation.copy()
            rotation[mask], translation[mask] = measured.rotation, measured.translation
            steps = Pose(rotation, translation)
    return Values.of({pose_kind(dim): (poses, compose_along(steps))})


def own_chain(piece: Dataset, robot: int) -> IntArray:
    """The robot's poses that its relative poses link to the first one, in time order.

    As far as each pose is linked to the next, that is the chain, and poses beyond its end may only be targets (of loop
    closures into another piece); in a graph that runs otherwise, all that hang together. Raises ModelError where an
    observer hangs on nothing.
    """
    from scipy.sparse.csgraph import breadth_first_order

    poses = piece.pose_keys[robot]
    which, _, _ = odometry_links(piece, robot, poses)
    gaps = np.flatnonzero(which < 0)
    if not len(gaps):
        return poses
    chain = poses[: gaps[0] + 1]
    observers = np.concatenate([_earlier(table, robot) for table in piece.tables])
    observers = observers[robot_of(observers) == robot]
    if observers.max() <= chain[-1]:
        return chain
    chain = poses[breadth_first_order(_own_graph(piece, robot, poses), 0, directed=False, return_predecessors=False)]
    if lost := observers[~np.isin(observers, chain)].tolist():
        raise ModelError(
            f"no odometry links {piece.names.describe(lost[0])} to {piece.names.describe(int(poses[0]))}; "
            f"cut the log there (teamslam.split does)"
        )
    return np.sort(chain)


def _earlier(table: Table, robot: int) -> IntArray:
    """The pose that each row belongs to: its observer, or the earlier of two of the robot's own poses."""
    return np.where((robot_of(table.keys) == robot).all(1), table.keys.min(1), table.keys[:, 0])


def _own_rows(piece: Dataset, robot: int) -> list[Table]:
    """The relative poses between two of the robot's own poses."""
    own = [t.select((robot_of(t.keys) == robot).all(1)) for t in piece.tables if t.model == "relative_pose"]
    return [table for table in own if len(table)]


def _own_graph(piece: Dataset, robot: int, poses: IntArray) -> sp.csr_array:
    """Which of the robot's poses a relative pose links, by their places in `poses`; a number is 1 + its row's place
    among all own rows."""
    pairs = np.concatenate([t.keys for t in _own_rows(piece, robot)] or [np.zeros((0, 2), np.int64)])
    there = np.isin(pairs, poses).all(1)
    pairs, first = np.unique(np.searchsorted(poses, pairs[there]), axis=0, return_index=True)
    number = 1 + np.flatnonzero(there)[first]
    return sp.csr_array((number, (pairs[:, 0], pairs[:, 1])), shape=(len(poses), len(poses)))


def _compose_by_tree(piece: Dataset, robot: int, poses: IntArray) -> Pose:
    """The poses composed outwards from the first along a spanning tree of relative poses, nearest first."""
    from scipy.sparse.csgraph import breadth_first_order

    dim, graph = piece.robots[robot], _own_graph(piece, robot, poses)
    measured = concatenate([_planar_or_whole(_of_bodies(t, unpack_poses(t)), dim) for t in _own_rows(piece, robot)])
    order, above = breadth_first_order(graph, 0, directed=False)
    rotation, translation = np.tile(np.eye(dim), (len(poses), 1, 1)), np.zeros((len(poses), dim))
    for place in order[1:].tolist():
        parent = int(above[place])
        row = int(graph[parent, place]) - 1
        step = measured[row] if row >= 0 else measured[int(graph[place, parent]) - 1].inverse()
        pose = Pose(rotation[parent], translation[parent]) @ step
        rotation[place], translation[place] = pose.rotation, pose.translation
    return Pose(rotation, translation)


def unpack_poses(table: Table) -> Pose:
    """The measured poses of a table of relative poses."""
    measured = unpack(table.values, Kind(table.dim - 2))
    assert isinstance(measured, Pose)
    return measured


def _planar_or_whole(pose: Pose, dim: int) -> Pose:
    return Pose(pose.rotation[:, :dim, :dim], pose.translation[:, :dim])


def compose_along(steps: Pose) -> Pose:
    """The poses (n + 1,) from the identity on along n steps: X_0 = I, X_t = X_{t-1} @ step_t."""
    poses = concatenate([Pose.identity(steps.dim, (1,)), steps])
    reach = 1
    while reach < len(poses):
        poses = concatenate([poses[:reach], poses[:-reach] @ poses[reach:]])
        reach *= 2
    return poses


def piece_start(piece: Dataset, robot: int) -> Values:
    """Start values of all of a piece's variables that some sighting fixes; those left open are absent."""
    return place_targets(dead_reckoning(piece, robot), piece.tables, piece.layout)


def place_targets(values: Values, tables: Iterable[Table], layout: Layout) -> Values:
    """`values` with every target of `layout` added that an already placed pose sees whole."""
    tables = list(tables)
    for whole_pose in (True, False):
        for table in tables:
            seen = sightings(table, values, layout, whole_pose)
            if seen is not None:
                values = Values.of(seen).update(values)
    return values


def sightings(
    table: Table, values: Values, layout: Layout, whole_pose: bool
) -> dict[Kind, tuple[IntArray, Pose | Array]] | None:
    """Where the targets of a table that are not in `values` yet were first seen, or None if it fixes none of them.

    `whole_pose`: relative poses, for targets that are poses; else positions, for targets that are points.
    """
    if whole_pose != (table.model == "relative_pose") or (not whole_pose and table.model not in WHOLE):
        return None
    targets = table.keys[:, 1]
    new = values.layout.contains(table.keys[:, 0]) & ~values.layout.contains(targets)
    kinds = layout.kinds[layout.index(targets)]
    new &= (kinds < 2) if whole_pose else (kinds >= 2)
    if not new.any():
        return None
    rows = np.flatnonzero(new)[np.unique(targets[new], return_index=True)[1]]
    found: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in map(Kind, np.unique(kinds[rows]).tolist()):
        of_kind = rows[kinds[rows] == kind]
        part = table.select(of_kind)
        observer = values.poses_of(part.keys[:, 0], max(kind.dim, part.dim))
        if whole_pose:
            measured = unpack(part.values, Kind(part.dim - 2))
            assert isinstance(measured, Pose)
            seen: Pose | Array = _shadow_pose(observer @ _of_bodies(part, measured), kind.dim)
        else:
            seen = observer.act(lift_points(measured_positions(part), observer.dim))[:, : kind.dim]
        found[kind] = (part.keys[:, 1], seen)
    return found


def measured_positions(table: Table) -> Array:
    """The targets' positions in their observers' bodies (m, d), from points or ranges with bearings."""
    z = table.values
    if table.model == "range_bearing" and table.dim == 2:
        z = z[:, :1] * np.stack([np.cos(z[:, 1]), np.sin(z[:, 1])], -1)
    elif table.model == "range_bearing":
        z = z[:, :1] * z[:, 1:]
    if table.sensor is None:
        return z
    dim = max(table.dim, table.sensor.dim)
    return table.sensor.lift(dim).act(lift_points(z, dim))


def _of_bodies(table: Table, measured: Pose) -> Pose:
    """A pose measured by a sensor, as seen from the observer's body."""
    return measured if table.sensor is None else table.sensor @ measured


def _shadow_pose(pose: Pose, dim: int) -> Pose:
    return pose if pose.dim == dim else Pose.from_xytheta(pose.xytheta())


def _choose(mask: BoolArray, yes: Pose, no: Pose) -> Pose:
    return Pose(
        np.where(mask[:, None, None], yes.rotation, no.rotation),
        np.where(mask[:, None], yes.translation, no.translation),
    )
