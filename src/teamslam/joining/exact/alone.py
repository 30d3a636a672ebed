"""What another way of one robot would cost the team: its own poses solved anew with all else held, and all solved anew.

Alone, the rows concerned are those that name a pose of that robot: work in proportion to its own log. Together it is
one solve of the component that it is in, from where the map is, without a join before it.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.joining.join.join import Joined
from teamslam.joining.join.optimum import usable_rows
from teamslam.model import WORLD, Submap, Table, Values, is_landmark, is_pose, robot_of
from teamslam.solver import Options, System, firm, optimise

FEW = Options(max_iterations=60, decrement=1e-3)


def excess_alone(tables: Sequence[Table], joined: Joined, submap: Submap) -> float:
    """How much more the team's rows cost once the robot of `submap` starts from there and everything else stays.

    Infinite where the robot is in no map, or where it cannot be solved.
    """
    home = _home(joined, submap)
    if home is None:
        return float("inf")
    values, own = point_of(home), _own_poses(submap, home)
    rows = [t.select(np.isin(t.keys, own).any(1) & t.told_by(values.layout)) for t in tables]
    rows = [t for t in rows if len(t) and (home.base == WORLD or not t.row.unary)]
    used = np.unique(np.concatenate([own, *(t.keys.ravel() for t in rows)]))
    here = values.only(used)
    held = np.append(used[~np.isin(used, own)], submap.base)
    return _excess(rows, here, _moved(here, submap, own), np.unique(held), submap)


def excess_together(tables: Sequence[Table], joined: Joined, submap: Submap) -> float:
    """How much more the rows of its map cost at the optimum that lies ahead once the robot of `submap` starts from
    there, with the landmarks that only it sees, and everything moves."""
    home = _home(joined, submap)
    if home is None:
        return float("inf")
    values = point_of(home)
    rows, _ = usable_rows(tables, values.layout, world=home.base == WORLD)
    seen_by_others = [t.keys[robot_of(t.keys[:, 0]) != robot_of(submap.base), -1] for t in rows]
    marks = np.setdiff1d(submap.keys[is_landmark(submap.keys)], np.concatenate(seen_by_others))
    own = np.union1d(_own_poses(submap, home), np.intersect1d(marks, home.keys))
    return _excess(rows, values, _moved(values, submap, own), frame_of(home), submap)


def _home(joined: Joined, submap: Submap) -> Submap | None:
    """The map that a submap's frame is in."""
    return next((c.map for c in joined.components if np.isin(submap.base, c.map.keys)), None)


def _own_poses(submap: Submap, home: Submap) -> IntArray:
    keys = submap.keys
    own = keys[is_pose(keys) & (robot_of(keys) == robot_of(submap.base))]
    return np.intersect1d(own, home.keys)


def _moved(values: Values, submap: Submap, keys: IntArray) -> Values:
    """The values with some keys where the submap has them, seen from its base; what it knows as a point and the map as
    a pose stays."""
    own = submap.all_values.only(keys)
    alike = own.layout.kinds == values.layout.kinds[values.layout.index(own.layout.keys)]
    return values.update(own.select(alike).transform(values.pose(submap.base)))


def _excess(rows: Sequence[Table], here: Values, there: Values, held: IntArray, submap: Submap) -> float:
    system = System(here.layout, tables=rows, fixed=held, names=submap.names)
    try:
        return firm(system, optimise(system, there, FEW)).cost - system.cost(here)
    except SolveError:
        return float("inf")
