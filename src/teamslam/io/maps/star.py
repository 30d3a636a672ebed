"""Maps as g2o graphs: vertices, and the map as edges from its frame to each variable.

An edge states where a variable was found, seen from the base pose, with the variable's own covariance; of a map in the
world's frame it is a prior. So whoever solves the graph finds the map again, and each variable's covariance. What is
correlated in the map (neighbours err together) is not in the graph, and is counted.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray
from teamslam.io.graphs import g2o_writer
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.model import WORLD, Dataset, Dropped, Kind, Table, pack, robot_of, whitening


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Laws: its vertices read back as the estimate, with the names; the
    optimum of its edges is the estimate, and marginal covariances there are the map's. InputError for what g2o has no
    tag for."""
    logs = [as_log(found) for found in maps]
    problem = next((problem for log in logs if (problem := g2o_writer.lacks(log)) is not None), None)
    if problem is not None:
        raise InputError(f"{problem}; write a CSV")
    for log, file in zip(logs, paths_of(path, len(maps)), strict=True):
        g2o_writer.write(log, file)
    count = sum(len(found.values) for found in maps)
    return (Dropped(count, "variables whose correlations with others are left out: each has its own covariance"),)


def as_log(found: MapEstimate) -> Dataset:
    """A map as measurements from its base pose; from the world, where the base pose cannot see them all (points in
    space, from the plane), as which its frame is taken then."""
    layout = found.values.layout
    flat = found.base == WORLD or len({Kind(kind).dim for kind in layout.kinds.tolist()}) > 1
    base = WORLD if flat else found.base
    owner = min(found.robots, default=1) if flat else int(robot_of(base))
    tables = []
    for kind, keys, data in found.values.parts():
        others = keys != found.base
        if others.any() and found.covariances is not None:
            noise = whitening(np.stack([found.covariances[place] for place in layout.index(keys[others]).tolist()]))
            tables.append(_table(base, owner, kind, keys[others], pack(data)[others], noise))
    dims = zip(robot_of(layout.keys).tolist(), layout.kinds.tolist(), strict=True)
    robots = {robot: Kind(kind).dim for robot, kind in dims if robot > 0}
    return Dataset(robots or {owner: 2}, tuple(tables), found.names, initial=found.values)


def _table(base: int, owner: int, kind: Kind, keys: IntArray, rows: Array, noise: Array) -> Table:
    """Variables of one kind as seen from the base, or from the world."""
    names, ids = np.stack([np.full(len(keys), base), keys], -1), np.arange(len(keys))
    if base == WORLD:
        return Table(owner, "map", "pose" if kind.is_pose else "position", kind.dim, names[:, 1:], rows, noise, ids)
    return Table(owner, "map", "relative_pose" if kind.is_pose else "point", kind.dim, names, rows, noise, ids)
