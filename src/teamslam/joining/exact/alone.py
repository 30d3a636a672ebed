"""What another way of one robot would cost the team by itself: its poses solved anew, with all else held.

The rows concerned are those that name a pose of that robot: work in proportion to the robot's own log.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining.exact.gap import point_of
from teamslam.joining.join.join import Joined
from teamslam.model import Submap, Table, is_pose, robot_of
from teamslam.solver import Options, System, optimise

FEW = Options(max_iterations=60, decrement=1e-3)


def excess(tables: Sequence[Table], joined: Joined, submap: Submap) -> float:
    """How much more the team's rows cost once the robot of `submap` starts from there and everything else stays.

    Infinite where the robot is in no map, or where it cannot be solved.
    """
    home = next((c.map for c in joined.components if np.isin(submap.base, c.map.keys)), None)
    if home is None:
        return float("inf")
    values = point_of(home)
    robot = int(robot_of(submap.base))
    moved = submap.all_values
    own = np.flatnonzero(is_pose(moved.layout.keys) & (robot_of(moved.layout.keys) == robot))
    own_keys = np.intersect1d(moved.layout.keys[own], values.layout.keys)
    rows = [
        t.select(np.asarray(np.isin(t.keys, own_keys).any(1) & values.layout.contains(t.keys).all(1))) for t in tables
    ]
    rows = [t for t in rows if len(t)]
    used = np.unique(np.concatenate([own_keys, *(t.keys.ravel() for t in rows)]))
    here = values.only(used)
    there = here.update(moved.only(own_keys).transform(values.pose(submap.base)))
    held = np.append(used[~np.isin(used, own_keys)], submap.base)
    system = System(here.layout, tables=rows, fixed=np.unique(held), names=submap.names)
    try:
        return optimise(system, there, FEW).cost - system.cost(here)
    except SolveError:
        return float("inf")
