"""Targets placed where they were first seen whole: poses by relative poses, points by points or ranges with bearings.

What no single sighting fixes is left to `triangulate`.
"""

from collections.abc import Iterable

import numpy as np

from teamslam.frontend.tags.whole_poses import as_relative_poses, tells_pose, voted
from teamslam.geometry import Array, IntArray, Pose, directions, lift_points
from teamslam.model import Kind, Layout, Table, Values, unpack

WHOLE = ("point", "range_bearing")  # models that fix a position at once


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
    if whole_pose != tells_pose(table) or (not whole_pose and table.model not in WHOLE):
        return None
    targets = table.keys[:, 1]
    new = values.layout.contains(table.keys[:, 0]) & ~values.layout.contains(targets)
    kinds = layout.kinds[layout.index(targets)]
    new &= (kinds < 2) if whole_pose else (kinds >= 2)
    new &= table.ranks == table.row.residual_rows(table.dim)
    if not new.any():
        return None
    rows = np.flatnonzero(new)[np.unique(targets[new], return_index=True)[1]]
    found: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in map(Kind, np.unique(kinds[rows]).tolist()):
        of_kind = rows[kinds[rows] == kind]
        part = table.select(of_kind)
        observer = values.poses_of(part.keys[:, 0], max(kind.dim, part.dim))
        if part.model == "corners":
            seen: Pose | Array = _voted(table, values, part.keys[:, 1]).onto(kind.dim)
        elif whole_pose:
            seen = (observer @ measured_poses(part, observer.dim)).onto(kind.dim)
        else:
            seen = observer.act(lift_points(measured_positions(part), observer.dim))[:, : kind.dim]
        found[kind] = (part.keys[:, 1], seen)
    return found


def _voted(table: Table, values: Values, targets: IntArray) -> Pose:
    """Where targets (k,) stand by all sightings from poses that have a place: one alone may stand for two poses."""
    whole = table.ranks == table.row.residual_rows(table.dim)
    seen = np.isin(table.keys[:, 1], targets) & values.layout.contains(table.keys[:, 0]) & whole
    own = table.select(np.flatnonzero(seen))
    keys, stand = voted(own, values.poses_of(own.keys[:, 0], 3))
    return stand[np.searchsorted(keys, targets)]


def measured_positions(table: Table) -> Array:
    """The targets' positions in their observers' bodies (m, d), from points or ranges with bearings."""
    z = table.values
    if table.model == "range_bearing":
        z = z[:, :1] * directions(table.dim).ray(z[:, 1:])
    if table.sensor is None:
        return z
    dim = max(table.dim, table.sensor.dim)
    return table.sensor.lift(dim).act(lift_points(z, dim))


def measured_poses(table: Table, dim: int) -> Pose:
    """The targets' poses in their observers' bodies (m,), from relative poses or corners: their shadow on the ground
    where the space has two dimensions, upright where it has three and they were measured on the ground."""
    measured = unpack(as_relative_poses(table).values, Kind(table.dim - 2))
    assert isinstance(measured, Pose)
    seen = of_bodies(table, measured).lift(max(dim, table.dim))
    return Pose(seen.rotation[..., :dim, :dim], seen.translation[..., :dim])


def of_bodies(table: Table, measured: Pose) -> Pose:
    """A pose measured by a sensor, as seen from the observer's body."""
    return measured if table.sensor is None else table.sensor @ measured
