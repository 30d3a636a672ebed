"""What all robots make alike of one part of the map of the set that they hold, before they speak of it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray
from teamslam.joining import Component, condense
from teamslam.joining.exact.coordinator import Far, common_keys
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.joining.exact.robot import Part, Sending, separators_of
from teamslam.joining.join.optimum import usable_rows
from teamslam.model import WORLD, Dataset, Sources, Submap, Table, Values, robot_of
from teamslam.robot.robot import Robot
from teamslam.solver import SubmapTerm, System

SECONDS = 10.0  # that a round may take on a line with a rate


@dataclass(frozen=True, eq=False)
class Stage:
    """One part of the map of a set: the part as it was `joined`, `sides` of its submaps, and how separators' places are
    written down (`common`)."""

    joined: Submap
    sides: tuple[Far, ...]
    raw: tuple[Table, ...]
    separators: IntArray
    common: Values

    @classmethod
    def of(cls, component: Component, by_id: Mapping[str, Submap]) -> "Stage":
        """Of a part, and the submaps of the set by their ids."""
        submaps, point = [by_id[name] for name in component.members], point_of(component.map)
        world = component.map.base == WORLD
        raw, _ = usable_rows([t for s in submaps for t in s.raw], point.layout, world=world)
        separators = separators_of(submaps, raw)
        sides = tuple(Far(submap, Sending.of(submap, separators)) for submap in submaps)
        return cls(component.map, sides, tuple(raw), separators, point.only(common_keys(sides, raw)))

    def of_robot(self, number: int) -> list[int]:
        """The places of a robot's submaps among all."""
        return [n for n, side in enumerate(self.sides) if int(robot_of(side.submap.base)) == number]

    @property
    def robots(self) -> set[int]:
        """Whose submaps are in it."""
        return {int(robot_of(side.submap.base)) for side in self.sides}

    def parts(self, robot: Robot) -> dict[int, Part]:
        """A robot's own submaps with the rows that they were built of, by their places."""
        pieces = {Sources.of(p.tables): p for closed in robot.closed for p in robot.pieces(closed.number)}
        own = [(n, self.sides[n]) for n in self.of_robot(robot.number)]
        return {n: Part.of(_piece(pieces, side.submap), side.submap, side.sending) for n, side in own}

    def as_sent(self, robots: Collection[int]) -> dict[int, Part]:
        """The submaps of robots that cannot be asked, as what they sent, by their places."""
        sides = [(n, self.sides[n]) for robot in robots for n in self.of_robot(robot)]
        return {n: Part.as_sent(side.submap, side.sending) for n, side in sides}

    def light(self, rate: float | None) -> bool:
        """Whether a round takes no longer on a line than it may."""
        if rate is None:
            return True
        sent = [8 * sum(self.sides[n].sending.numbers for n in self.of_robot(robot)) for robot in self.robots]
        return max(sent) <= SECONDS * rate

    def map_at(self, common: Values, interiors: Mapping[int, Values], cost: float) -> Submap:
        """The whole part with its separators at `common`: the `interiors` that are known of some submaps, each in its
        frame, all others where their submaps put them then. Its information is that of the submaps there, each as it
        was sent."""
        values = point_of(self.joined).update(common)
        for n, side in enumerate(self.sides):
            if n in interiors:
                values = values.update(interiors[n].transform(common.pose(side.submap.base)))
            elif not side.sending.whole:
                values = values.update(condense(side.submap, side.sending.kept.keys)[1].recover_from(values))
        submaps = [SubmapTerm.of(side.submap) for side in self.sides]
        system = System(values.layout, tables=self.raw, submaps=submaps, fixed=frame_of(self.joined))
        information = system.linearise(values).information.to_csr()
        free = values.only(system.free.keys)
        return replace(self.joined, values=free, information=information, cost=cost, chi2=cost)


def interiors_of(parts: Mapping[int, Part]) -> dict[int, Values]:
    """Where submaps are that a robot keeps the inside of to itself, by their places: all that is left to be known of
    their parts once rounds have ended."""
    kept = {n: part for n, part in parts.items() if not part.sends_whole}
    return {n: part.values.only(np.setdiff1d(part.system.free.keys, part.kept.keys)) for n, part in kept.items()}


def _piece(pieces: Mapping[Sources, Dataset], submap: Submap) -> Dataset:
    if submap.sources not in pieces:
        raise SolveError(f"the rows of {submap.id} are not at hand")
    return pieces[submap.sources]


def robots_of(component: Component, by_id: Mapping[str, Submap]) -> Sequence[int]:
    """Whose submaps are in a part, rising."""
    return sorted({int(robot_of(by_id[name].base)) for name in component.members})
