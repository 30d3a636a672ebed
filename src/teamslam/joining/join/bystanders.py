"""Poses that stood by: each saw what others place, and nothing tells where about it they stood.

A robot without odometry has poses just where it saw or was seen. Where one of them saw a landmark alone, that is a map
of its own by the letter, but nothing in it is news: the landmark is in another map, and where the pose is, is open.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import IntArray
from teamslam.joining.join.join import Joined
from teamslam.model import Submap, is_landmark, is_pose, robot_of

ABOUT = "no odometry leads there, and all that was seen from there is placed by others: where about it that was is open"
EACH = "each is alone: "


@dataclass(frozen=True, eq=False)
class Bystander:
    """Poses (n,) of one robot that are in no map, and why."""

    poses: IntArray
    reason: str


def without_bystanders(joined: Joined) -> tuple[Joined, list[Bystander]]:
    """The join without maps of one pose that saw nothing but landmarks which a map of more poses holds, and these poses
    robot by robot. Law: no landmark and no pose of a map of several poses is lost with them."""
    maps = [component.map for component in joined.components]
    placed = np.concatenate([np.zeros(0, np.int64), *(_landmarks(m) for m in maps if len(_poses(m)) > 1)])
    stood_by = [len(_poses(m)) == 1 and bool(np.isin(_landmarks(m), placed).all()) and bool(m.dof) for m in maps]
    poses = np.concatenate([np.zeros(0, np.int64), *(_poses(m) for m, by in zip(maps, stood_by, strict=True) if by)])
    found = [_bystander(poses[robot_of(poses) == robot]) for robot in np.unique(robot_of(poses)).tolist()]
    return of_these(joined, [not by for by in stood_by]), found


def _bystander(poses: IntArray) -> Bystander:
    return Bystander(poses, ABOUT if len(poses) == 1 else EACH + ABOUT)


def _poses(map: Submap) -> IntArray:
    return np.asarray(map.keys[is_pose(map.keys) & (robot_of(map.keys) > 0)])


def _landmarks(map: Submap) -> IntArray:
    return np.asarray(map.keys[is_landmark(map.keys)])


def of_these(joined: Joined, held: Sequence[bool]) -> Joined:
    """The join with those of its components that are held; the first of them needs no reason."""
    kept, reasons = [n for n, holds in enumerate(held) if holds], ("", *joined.reasons)
    components = tuple(joined.components[n] for n in kept)
    return replace(joined, components=components, reasons=tuple(reasons[n] for n in kept[1:]))
