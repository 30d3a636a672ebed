"""A map as a start for the same log at other moments: poses between those that it has, landmarks where they are."""

from dataclasses import replace

import numpy as np

from teamslam.frontend.interpolate import interpolate
from teamslam.geometry import IntArray, Pose, concatenate
from teamslam.joining import Joined
from teamslam.model import WORLD, Dataset, Kind, Submap, Values, index_of, is_pose, pose_kind, robot_of
from teamslam.model.sparse import sp

Homes = dict[int, tuple[IntArray, IntArray]]
"""Of each robot the stamps of its poses, rising, and which component each is in."""


def near(joined: Joined, log: Dataset) -> Joined | None:
    """The maps with the poses that `log` has; None where one of them would have none, or is in the world's frame."""
    homes = {robot: _homes(joined, robot) for robot in log.robots}
    moved = [_moved(component.map, n, log, homes) for n, component in enumerate(joined.components)]
    whole = [
        replace(component, map=map) for component, map in zip(joined.components, moved, strict=True) if map is not None
    ]
    return Joined(tuple(whole), joined.reasons, log=log) if len(whole) == len(moved) else None


def _homes(joined: Joined, robot: int) -> tuple[IntArray, IntArray]:
    keys = [c.map.trajectory_keys(robot) for c in joined.components]
    none = np.zeros(0, np.int64)
    ticks = np.concatenate([none, *(index_of(k) for k in keys)])
    of = np.concatenate([none, *(np.full(len(k), n) for n, k in enumerate(keys))])
    order = np.argsort(ticks, kind="stable")
    return ticks[order], of[order]


def _moved(submap: Submap, number: int, log: Dataset, homes: Homes) -> Submap | None:
    if submap.base == WORLD:
        return None
    known = submap.all_values
    ways: dict[Kind, list[tuple[IntArray, Pose]]] = {}
    for robot in submap.robots_in_it:
        keys = _nearest(log.pose_keys[robot], *homes[robot], number)
        mine = submap.trajectory_keys(robot)
        if len(keys):
            at, stamps = index_of(keys), index_of(mine)
            poses, _ = interpolate(stamps, known.poses_of(mine, log.robots[robot]), at, int(stamps[-1] - stamps[0]) + 1)
            ways.setdefault(pose_kind(log.robots[robot]), []).append((keys, poses))
    driven = [keys for found in ways.values() for keys, _ in found if robot_of(keys[:1])[0] == robot_of(submap.base)]
    if not driven:
        return None
    base = int(driven[0][np.argmin(np.abs(index_of(driven[0]) - index_of(submap.base)))])
    there = known.select(~is_pose(known.layout.keys))
    for kind, way in ways.items():
        keys, poses = np.concatenate([k for k, _ in way]), concatenate([p for _, p in way])
        there = there.update(Values.of({kind: (keys, poses)}))
    seen = there.seen_from(there.pose(base), there.layout)
    values = seen.select(seen.layout.keys != base)
    nothing = sp.csr_array((values.layout.dof, values.layout.dof))
    return replace(submap, base=base, values=values, information=nothing, raw=())


def _nearest(keys: IntArray, ticks: IntArray, of: IntArray, number: int) -> IntArray:
    """Those of a robot's keys whose nearest pose in the maps is in the component of a number."""
    at = index_of(keys)
    right = np.minimum(np.searchsorted(ticks, at), len(ticks) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(at - ticks[left] <= np.abs(ticks[right] - at), left, right)
    return np.asarray(keys[of[nearest] == number])
