"""The frame of a joined map: the first pose of its first robot, or the world where enough was measured in it.

Positions and poses in the world (GPS, survey) fix the gauge themselves. The start is moved there by one rigid fit over
them. With too few of them (one position in the plane, fewer than three in space) the map is free to turn in the world:
then it stays in the frame of its first pose, and what was measured in the world waits for what may come, or is told as
left out in the end. Where one of the maps that are joined is written in the world's frame already, that frame is held,
and all go there; robots of a plane take the ground of the world for theirs.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import IntArray, Pose, align, lift_points
from teamslam.joining.join.registration import registered
from teamslam.joining.start.triangulate import kinds_of
from teamslam.model import WORLD, Kind, Submap, Table, Values, is_landmark, point_kind, pose_kind

LEAST = 1e-6  # the rigidity of a fit below which it is free to turn


def anchor(start: Values, root: Submap, tables: Sequence[Table]) -> tuple[Values, IntArray, list[Table]]:
    """The start values in the frame of the joined map, the keys that are held fixed there (the gauge), and the tables
    that count: all of them, or those that were not measured in the world."""
    if start.layout.contains(WORLD):
        return _from_the_world(start), np.array([WORLD]), list(tables)
    absolute = [t for t in tables if t.row.unary]
    fit = _in_the_world(start, absolute, root.base_dim) if absolute else None
    if fit is None:
        first = root.first_pose
        seen = (
            start if first == root.base else start.transform(start.poses_of(np.array(first), root.base_dim).inverse())
        )
        return seen, np.array([first]), [t for t in tables if not t.row.unary]
    return start.transform(fit), np.zeros(0, np.int64), list(tables)


def _from_the_world(start: Values) -> Values:
    """The start values as the world sees them; where some of them are of a plane, what of that plane's place in the
    world has no place in the plane (height, tilt) is left to the solver."""
    dim = min(Kind(kind).dim for kind in start.layout.kinds.tolist())
    world = start.pose(WORLD)
    moved = start.transform(world.onto(dim).inverse())
    return moved.update(Values.of({pose_kind(world.dim): (np.array([WORLD]), Pose.identity(world.dim, (1,)))}))


def in_the_world(fixed: IntArray) -> bool:
    """Whether a map whose gauge is `fixed` is written in the world's frame."""
    return not len(fixed) or int(fixed[0]) == WORLD


def surveyed(values: Values, tables: Sequence[Table]) -> Values:
    """`values`, which are written in the world's frame, with the landmarks added whose places `tables` measured there:
    all of them, in as many dimensions as anybody saw them in."""
    seen = [t.select(is_landmark(t.keys[:, -1]) & ~values.layout.contains(t.keys[:, -1])) for t in tables]
    seen = [t for t in seen if len(t)]
    if not any(t.model == "position" for t in seen):
        return values
    kinds = kinds_of(seen)
    for table in seen:
        if table.model != "position":
            continue
        of_its_kind = kinds.kinds[kinds.index(table.keys[:, 0])] == point_kind(table.dim)
        whole = np.flatnonzero(of_its_kind & (table.ranks == table.dim) & ~values.layout.contains(table.keys[:, 0]))
        keys, first = np.unique(table.keys[whole, 0], return_index=True)
        values = values.update(Values.of({point_kind(table.dim): (keys, table.values[whole[first]])}))
    return values


def _in_the_world(start: Values, absolute: Sequence[Table], dim: int) -> Pose | None:
    """What takes a map into the world, None where it would be free to move there."""
    if any((t.ranks < t.row.residual_rows(t.dim)).any() for t in absolute):
        found = registered(start, absolute, dim)
        return found.pose if found.rank == len(found.information) else None
    here = np.concatenate([start.positions(t.keys[:, 0], dim) for t in absolute])
    there = np.concatenate([lift_points(t.values[:, : min(dim, t.dim)], dim) for t in absolute])
    whole = [t.select(t.ranks == t.row.residual_rows(t.dim)) for t in absolute if t.model == "pose" and t.dim == dim]
    turned = [t for t in whole if len(t)]
    if turned:
        mine = np.concatenate([start.poses_of(t.keys[:, 0], dim).rotation for t in turned])
        theirs = np.concatenate([t.values[:, dim:].reshape(-1, dim, dim) for t in turned])
        return align(here, there, source_rotations=mine, target_rotations=theirs).pose
    fit = align(here, there)
    return fit.pose if fit.rigidity >= LEAST else None
