"""Poses that stood by: each saw what others place, and nothing tells where about it they stood.

A robot without odometry has poses just where it saw or was seen. Where one of them saw a landmark alone, that is a map
of its own by the letter, but nothing in it is news: the landmark is in another map, and where the pose is, is open.
Where what it saw does fix a place, and none was found, that is said instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import IntArray
from teamslam.joining.join.join import Joined
from teamslam.joining.place.reasons import NO_PLACE
from teamslam.model import Submap, is_landmark, is_pose, robot_of

ABOUT = "no odometry leads there, and all that was seen from there is placed by others: where about it that was is open"
NOWHERE = (
    "no odometry leads there, and no place was found from where all that was seen from there is where others have it;"
    " look for landmarks that were taken for others, or for a map that is bent"
)
EACH = "each is alone: "


@dataclass(frozen=True, eq=False)
class Bystander:
    """Poses (n,) of one robot that are in no map, and why."""

    poses: IntArray
    reason: str


def without_bystanders(joined: Joined) -> tuple[Joined, list[Bystander]]:
    """The join without maps of one pose that saw nothing but landmarks which a map of more poses holds, and these poses
    robot by robot, those that are open and those for which no place was found. Law: no landmark and no pose of a map of
    several poses is lost with them."""
    maps = [component.map for component in joined.components]
    placed = np.concatenate([np.zeros(0, np.int64), *(_landmarks(m) for m in maps if len(_poses(m)) > 1)])
    stood_by = [len(_poses(m)) == 1 and bool(np.isin(_landmarks(m), placed).all()) and bool(m.dof) for m in maps]
    poses: dict[str, list[IntArray]] = {}
    for whole, by, why in zip(maps, stood_by, ("", *joined.reasons), strict=True):
        if by:
            poses.setdefault(NOWHERE if NO_PLACE in why else ABOUT, []).append(_poses(whole))
    found = [each for why, of in poses.items() for each in _by_robot(np.concatenate(of), why)]
    return of_these(joined, [not by for by in stood_by]), found


def _by_robot(poses: IntArray, why: str) -> list[Bystander]:
    own = [poses[robot_of(poses) == robot] for robot in np.unique(robot_of(poses)).tolist()]
    return [Bystander(of, why if len(of) == 1 else EACH + why) for of in own]


def _poses(map: Submap) -> IntArray:
    return np.asarray(map.keys[is_pose(map.keys) & (robot_of(map.keys) > 0)])


def _landmarks(map: Submap) -> IntArray:
    return np.asarray(map.keys[is_landmark(map.keys)])


def of_these(joined: Joined, held: Sequence[bool]) -> Joined:
    """The join with those of its components that are held; the first of them needs no reason."""
    kept, reasons = [n for n, holds in enumerate(held) if holds], ("", *joined.reasons)
    components = tuple(joined.components[n] for n in kept)
    return replace(joined, components=components, reasons=tuple(reasons[n] for n in kept[1:]))
