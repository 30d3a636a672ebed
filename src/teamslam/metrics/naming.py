"""Two logs of one team may number its robots and landmarks differently: what counts is what people call them."""

from collections.abc import Callable, Iterable

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray
from teamslam.model import Names, Submap, Values, index_of, is_landmark, is_pose, landmark_key, pose_key, robot_of


def as_called(truth: Values, theirs: Names, map: Submap) -> Values:
    """What the truth of a log with other names knows of a map, under the map's own keys: by names and stamps.

    Law: with the map's own names it is the truth of the map's variables. Raises InputError where one of the two counts
    poses and the other has their times, so that nothing tells which pose is which.
    """
    if theirs == map.names:
        return truth.select(np.isin(truth.layout.keys, map.keys))
    if theirs.counts != map.names.counts:
        one, other = ("counts poses", "has their times") if map.names.counts else ("has times", "counts poses")
        raise InputError(f"the map {one}, what it is compared with {other}: nothing tells which pose is which")
    keys = truth.layout.keys
    ours = np.full(len(keys), -1)
    poses, marks = is_pose(keys), is_landmark(keys)
    robots = _translated(robot_of(keys[poses]), theirs.robot, map.names.robot, map.robots_in_it)
    ticks = index_of(keys[poses])
    if theirs.tick_s != map.names.tick_s:
        ticks = np.rint(ticks * (theirs.tick_s / map.names.tick_s)).astype(np.int64)
    ours[poses] = np.where(robots > 0, pose_key(np.maximum(robots, 1), ticks), -1)
    found = _translated(keys[marks], theirs.landmark, map.names.landmark, map.landmark_keys.tolist())
    ours[marks] = np.where(found >= 0, landmark_key(np.maximum(found, 0)), -1)
    known, first = np.unique(ours, return_index=True)
    first = first[np.isin(known, map.keys) & (known >= 0)]
    return truth.renamed(keys[first], ours[first])


def _translated(
    numbers: IntArray, theirs: Callable[[int], str], ours: Callable[[int], str], known: Iterable[int]
) -> IntArray:
    """Our numbers for what they call by theirs; -1 for a name that is not among `known`."""
    by_name = {ours(number): number for number in known}
    each, back = np.unique(numbers, return_inverse=True)
    return np.array([by_name.get(theirs(int(number)), -1) for number in each], np.int64)[back.reshape(numbers.shape)]
