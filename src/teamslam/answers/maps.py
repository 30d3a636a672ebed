"""Which of a team's maps something is in: robots that could not be joined have maps with frames of their own."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray, Pose, lift_tangent
from teamslam.model import Asked, Names, Submap, index_of, pose_kind, robot_asked, robot_names
from teamslam.solver import Covariances


class Maps(Protocol):
    """Who has a team's maps, one for each component, and the covariances of each."""

    @property
    def maps(self) -> Sequence[Submap]:
        """One for each component."""

    @property
    def covariances(self) -> Sequence[Covariances]:
        """Of each map."""


Find = Callable[[Asked, Names, IntArray], int]


def names_of(team: Maps) -> Names:
    """What people call all that is in the maps."""
    first, *others = (submap.names for submap in team.maps)
    return first.merge(other for other in others if other != first)


def keys_of(team: Maps) -> IntArray:
    """The variables of all maps, the bases among them, sorted."""
    return np.unique(np.concatenate([submap.keys for submap in team.maps]))


def frame_of(submap: Submap) -> str:
    """Whose frame a map is in, in words."""
    return f"in the frame of {submap.names.describe(submap.base)}" if submap.base >= 0 else "in the world frame"


def found_in(team: Maps, asked: Sequence[Asked], find: Find, component: int | None) -> tuple[int, list[int]]:
    """The number (from 1) of the one map that holds all of what is asked, and the keys of that. ModelError in words
    where none does, or several do."""
    if component is not None and not 1 <= component <= len(team.maps):
        raise ModelError(f"there {_are(len(team.maps), 'map')}, counted from 1; found component {component}")
    keys = keys_of(team) if component is None else team.maps[component - 1].keys
    found = [find(one, names_of(team), keys) for one in asked]
    if component is not None:
        return component, found
    inside = [n for n, submap in enumerate(team.maps, 1) if all((submap.keys == key).any() for key in found)]
    if len(inside) == 1:
        return inside[0], found
    told = " and ".join(map(str, asked))
    if not inside:
        raise ModelError(
            f"{told} are in different maps, which could not be joined: nothing is known of one from the other"
        )
    where = ", ".join(f"component={number}" for number in inside)
    raise ModelError(f"{told} is in {len(inside)} maps with frames of their own; choose one: {where}")


def robot_found(team: Maps, robot: Asked, component: int | None) -> tuple[int, int]:
    """The number (from 1) of the map that a robot has poses in, and the robot's own number. ModelError as above."""
    if component is not None:
        number, (key,) = found_in(team, [robot], robot_asked, component)
        return number, key
    key = robot_asked(robot, names_of(team), keys_of(team))
    inside = [n for n, submap in enumerate(team.maps, 1) if key in submap.robots_in_it]
    if len(inside) > 1:
        where = ", ".join(f"component={number}" for number in inside)
        raise ModelError(
            f"robot {names_of(team).robot(key)} has poses in {len(inside)} maps with frames of their own; choose one: "
            f"{where}"
        )
    return inside[0], key


def robots_in(team: Maps) -> tuple[str, ...]:
    """The names of all robots, in the order of their numbers."""
    return tuple(robot_names(names_of(team), keys_of(team)))


def landmark_names_in(team: Maps) -> tuple[str, ...]:
    """The names of all landmarks, map by map in the order of their numbers."""
    return tuple(m.names.landmark(n) for m in team.maps for n in index_of(m.landmark_keys).tolist())


def blocks_lifted(covariances: Covariances, submap: Submap, keys: IntArray, dim: int) -> Array:
    """The covariances of poses (n, dof, dof) in the chart of `dim`; planar ones among spatial cannot tilt or rise."""
    dof = pose_kind(dim).dof
    out = np.zeros((len(keys), dof, dof))
    for place, block in enumerate(covariances.blocks(keys)):
        lift = lift_tangent(2 if len(block) == 3 else 3, dim)
        out[place] = block if len(block) == dof else lift @ block @ lift.T
    return out


def poses_at(submap: Submap, keys: IntArray) -> Pose:
    """Poses of one robot, of its own dimension."""
    layout = submap.all_values.layout
    dims = 2 + layout.kinds[layout.index(keys)] % 2
    return submap.all_values.poses_of(keys, int(dims.max(initial=2)))


def _are(count: int, noun: str) -> str:
    return f"is 1 {noun}" if count == 1 else f"are {count} {noun}s"
