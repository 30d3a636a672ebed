"""What a robot makes of its closed pieces and of what it hears. It takes its time, beside the steps.

    submaps   Algorithm 1 of each piece: what `build` makes offline, to the bit; these are sent to others
    map       Algorithm 2 of the submaps and of those of others, each condensed to what the rest of them needs:
              landmarks, the poses where pieces meet, and those that others saw; its own linearised where the map is

A closed piece that got a late row comes again with a higher version, and replaces.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from teamslam.errors import SolveError, TeamslamError
from teamslam.geometry import IntArray
from teamslam.joining import Joined, build, condense, join, separators
from teamslam.joining.start.blunt import levelled
from teamslam.model import Dataset, Submap
from teamslam.robot.anew import Linearised
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS

Name = tuple[str, int]


@dataclass(frozen=True, eq=False)
class Stretch:
    """The submaps of one closed stretch up to the pose `end`, and why there is none of some of its parts."""

    version: int
    end: int | None
    submaps: tuple[Submap, ...]
    unbuilt: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Atlas:
    """The stretches of a robot's way by their number; and, by id and version, what their map is made of (`short`), with
    the submaps of others, and the rows of its own (`pieces`), where they were at hand."""

    stretches: Mapping[int, Stretch] = field(default_factory=dict)
    short: Mapping[Name, Linearised] = field(default_factory=dict)
    pieces: Mapping[Name, Dataset] = field(default_factory=dict)

    def with_stretch(
        self, number: int, version: int, pieces: Sequence[Dataset], end: int | None, options: Options = DEFAULTS
    ) -> "Atlas":
        """With the submaps of one stretch, given by the pieces of log that it is made of, up to the pose `end`; older
        than what is there, it changes nothing."""
        held = self.stretches.get(number)
        if held is not None and held.version >= version:
            return self
        submaps, unbuilt = list[Submap](), list[str]()
        before = {(submap.id, submap.version) for submap in held.submaps} if held is not None else set[Name]()
        rows = {name: piece for name, piece in self.pieces.items() if name not in before}
        for piece in pieces:
            try:
                submaps.append(build(piece, version=version, options=options))
            except SolveError as error:
                unbuilt.append(str(error))
            else:
                rows[submaps[-1].id, version] = piece
        stretch = Stretch(version, end, tuple(submaps), tuple(unbuilt))
        return replace(self, stretches={**self.stretches, number: stretch}, pieces=rows)

    def in_short(self, heard: Sequence[Submap] = (), robot: int = 0) -> "Atlas":
        """With what the map is made of brought up to date: its own submaps, and those that were `heard` but for those
        of `robot`, whose atlas it is."""
        own = self.submaps
        submaps = [*own, *(submap for submap in heard if robot not in submap.robots)]
        needed = separators(submaps, landmarks=True)
        ends = np.array([s.end for s in self.stretches.values() if s.end is not None], np.int64)
        short = {}
        for number, submap in enumerate(submaps):
            keys = submap.values.layout.keys
            keep = np.union1d(needed[submap.id], keys[np.isin(keys, ends)])
            held = self.short.get((submap.id, submap.version))
            if held is None or not np.array_equal(held.keep, keep):
                piece = self.pieces.get((submap.id, submap.version))
                held = Linearised(keep, _condensed(submap, keep), submap, submap.all_values, number < len(own), piece)
            short[submap.id, submap.version] = held
        return replace(self, short=short)

    def anew(self) -> "Atlas":
        """With those of its own submaps that the map has moved linearised where it has them, as long as there is a map
        then."""
        if self.joined is None:
            return self
        places = [part.all_values for part in self.parts]
        short = dict(self.short)
        for name, held in self.short.items():
            known = next((values for values in places if values.layout.contains(held.submap.base)), None)
            short[name] = held if known is None else held.anew(known)
        if all(short[name] is held for name, held in self.short.items()):
            return self
        made = replace(self, short=short)
        return self if made.joined is None else made

    @property
    def submaps(self) -> tuple[Submap, ...]:
        """All submaps of its own, as they would be sent."""
        return tuple(submap for _, stretch in sorted(self.stretches.items()) for submap in stretch.submaps)

    @property
    def unbuilt(self) -> tuple[str, ...]:
        """Why pieces gave no submap."""
        return tuple(reason for _, stretch in sorted(self.stretches.items()) for reason in stretch.unbuilt)

    @cached_property
    def joined(self) -> Joined | None:
        """The map of what is in short; of its own submaps alone where those of others do not go with them. None where
        there are none, or no map can be made of them."""
        for shorts in (self.short.values(), [short for short in self.short.values() if short.own]):
            try:
                return _with_levels([short.submap for short in shorts]) if shorts else None
            except TeamslamError:
                continue
        return None

    @property
    def parts(self) -> tuple[Submap, ...]:
        """The parts of the map; none where there is no map."""
        return tuple(component.map for component in self.joined.components) if self.joined is not None else ()

    def map_with(self, pose: int) -> Submap | None:
        """The part of the map that holds a pose."""
        return next((part for part in self.parts if pose in part.keys), None)


def _with_levels(submaps: Sequence[Submap]) -> Joined:
    """Their map, with the landmarks that lie on a level with all who range them where that is known to second order."""
    joined = join(submaps)
    found = submaps
    for component in joined.components:
        try:
            found = levelled(found, component.map)
        except SolveError:  # a map that only just holds: as it is
            continue
    return joined if found is submaps else join(found, near=joined)


def _condensed(submap: Submap, keep: IntArray) -> Submap:
    try:
        return condense(submap, keep)[0]
    except SolveError:  # an interior that only just holds: as it is
        return submap
