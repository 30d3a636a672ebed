"""A truth that was taken at other stamps than the map's poses, such as by a motion capture: brought to these stamps."""

from dataclasses import replace

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.interpolate import on_a_smooth_way
from teamslam.geometry import IntArray, Pose
from teamslam.metrics.naming import as_called
from teamslam.model import Kind, Names, Submap, Values, index_of, is_landmark, is_pose, pose_kind, robot_names, robot_of

LONGEST_GAP_S = 1.0  # between two samples with a pose of the map between them


def at_stamps_of(map: Submap, truth: Values, theirs: Names) -> Values:
    """What a truth knows of a map, under the map's own keys: robots and landmarks by their names, poses interpolated to
    the map's stamps between samples at most 1 s apart; of a map that counts its poses, those whose stamp is the count.

    A lone robot of the truth is the lone robot of the map, whatever they are called. InputError where the truth has
    robots, and none of them is in the map.
    """
    marks = truth.select(is_landmark(truth.layout.keys))
    found = as_called(marks, replace(theirs, tick_s=map.names.tick_s), map)
    keys = truth.layout.keys
    named, ours = robot_names(theirs, keys), robot_names(map.names, map.keys)
    pairs = {number: ours[name] for name, number in named.items() if name in ours}
    if len(named) == len(ours) == 1:
        pairs = dict(zip(named.values(), ours.values(), strict=True))
    if named and not pairs and ours:
        raise InputError(
            f"the truth is of the robots {', '.join(named)}, the map of {', '.join(ours)}: none is in both; call them "
            f"alike (of TUM files, the name of a robot is that of its file)"
        )
    for number, robot in pairs.items():
        found = found.update(_at(map, robot, truth, np.sort(keys[is_pose(keys) & (robot_of(keys) == number)]), theirs))
    return found


def _at(map: Submap, robot: int, truth: Values, samples: IntArray, theirs: Names) -> Values:
    """The poses of one robot of the map as the truth's samples have them."""
    own, ticks = map.trajectory_keys(robot), np.rint(theirs.stamps_s(samples) / map.names.tick_s).astype(np.int64)
    kinds = truth.layout.kinds[truth.layout.index(samples)]
    dim = 2 + int((kinds % 2).max())
    longest = 0 if map.names.counts else round(LONGEST_GAP_S / map.names.tick_s)
    way: Pose = truth.poses_of(samples, dim)
    poses, good = on_a_smooth_way(ticks, way, index_of(own), longest)
    kind: Kind = pose_kind(dim)
    return Values.of({kind: (own[good], poses[np.flatnonzero(good)])})
