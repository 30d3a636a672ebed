"""A team's map in files: what joining by a tree leaves behind, and how to look at it.

All of it need not fit into memory: robots are looked at one by one. Where it does fit, `gather` makes of it the map
that `teamslam.join` gives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.io.files.npz import read_arrays
from teamslam.io.files.whole import whole_file
from teamslam.io.maps.tum import write_trajectories
from teamslam.io.submaps.arrays import read_submap
from teamslam.joining import Component, Joined
from teamslam.joining.join.interiors import members_of
from teamslam.joining.join.join import in_order
from teamslam.joining.join.optimum import Optimum, usable_rows
from teamslam.model import WORLD, Layout, Submap, Values, is_landmark, rebased, robot_of
from teamslam.model.layout import rows_of
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS


@dataclass(frozen=True)
class Barren:
    """A job that no submap can be made of, by its number, and why."""

    number: int
    reason: str


@dataclass(frozen=True, eq=False)
class TreeMap:
    """`joined`: the variables that the last joined groups shared, with their information; one component for each part
    of the team that hangs together. `estimates`: by component, the files that hold all variables, in the frame of the
    component's map. `submaps`: the files of the leaves. `unbuilt`: the jobs that no submap could be made of."""

    joined: Joined
    estimates: tuple[tuple[Path, ...], ...]
    submaps: tuple[Path, ...]
    unbuilt: tuple[Barren, ...] = ()

    def leaves(self) -> tuple[Submap, ...]:
        """All submaps, in memory, by base and id."""
        return tuple(in_order(read_submap(file, prove=False) for file in self.submaps))

    def values(self, component: int = 0, *, robot: int | None = None) -> Values:
        """The estimate of all variables of a component, its frame among them; or of one robot's poses alone."""
        every = _together([_of_robot(read_values(file), robot) for file in self.estimates[component]])
        return every.select(every.layout.keys != WORLD)  # the frame of the world is no variable

    def landmarks(self, component: int = 0) -> Values:
        """The estimate of a component's landmarks."""
        return _together([_of_landmarks(read_values(file)) for file in self.estimates[component]])

    def write_trajectories(self, folder: Path) -> list[Path]:
        """Each robot's way as `<robot>.tum`, in folders `part_2`, ... those of further components. One robot is in
        memory at a time."""
        files = []
        for number, component in enumerate(self.joined.components):
            place = folder if number == 0 else folder / f"part_{number + 1}"
            for robot in component.map.robots:
                files += write_trajectories(self.values(number, robot=robot), component.map.names, place)
        return files


def gather(tree: TreeMap, options: Options = DEFAULTS) -> Joined:
    """The whole map in memory, with its information: all submaps joined at once, from the tree's estimate on.

    What the levels of the tree left to second order is removed. Law: the map is an optimum of the cost that
    `teamslam.join` has, and its map where that cost has one optimum. It may have more: a submap whose frame is a pose
    that hangs on the rest by a poorly known turn is a Gaussian in the wrong coordinates, with an optimum on either side
    of the truth, and the tree's estimate may lie nearer to another one, of lower or of higher cost.
    """
    submaps = {submap.id: submap for submap in tree.leaves()}
    components = []
    for number, component in enumerate(tree.joined.components):
        members = in_order(submaps[id_] for id_ in component.members)
        raw, _ = usable_rows([t for m in members for t in m.raw], (start := tree.values(number)).layout)
        if len(members) == 1 and not raw:
            components.append(Component(rebased(members[0], members[0].first_pose), None, component.members))
            continue
        fixed = np.array([b for b in (component.map.base,) if b != WORLD], np.int64)
        found = Optimum.near(members_of(members), start, raw, fixed, options)
        components.append(Component(found.map(component.map.base_dim), found.solution, component.members))
    return Joined(tuple(components), tree.joined.reasons)


# --- files ------------------------------------------------------------------------------------------------------------


def write_values(values: Values, path: Path) -> None:
    """An estimate as arrays keys, kinds, state: whole or not at all."""
    with whole_file(path) as file:
        np.savez(file, keys=values.layout.keys, kinds=values.layout.kinds, state=values.state)


def read_values(path: Path) -> Values:
    """What `write_values` wrote."""
    arrays = read_arrays(path)
    return Values(Layout(arrays["keys"], arrays["kinds"]), arrays["state"])


def _of_robot(values: Values, robot: int | None) -> Values:
    return values if robot is None else values.select(robot_of(values.layout.keys) == robot)


def _of_landmarks(values: Values) -> Values:
    mask: BoolArray = is_landmark(values.layout.keys)
    return values.select(mask)


def _together(parts: Sequence[Values]) -> Values:
    """Estimates that agree where they overlap, as one."""
    layout = Layout.of(np.concatenate([p.layout.keys for p in parts]), np.concatenate([p.layout.kinds for p in parts]))
    state = np.zeros(int(layout.state_start[-1]))
    for part in parts:
        at: IntArray = layout.index(part.layout.keys)
        state[rows_of(layout.state_start[at], np.diff(part.layout.state_start))] = part.state
    return Values(layout, state)
