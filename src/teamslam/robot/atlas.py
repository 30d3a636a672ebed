"""What a robot makes of its closed pieces: a submap of each, and their map. It takes its time, beside the steps.

    submaps   Algorithm 1 of each piece: what `build` makes offline, to the bit; these are sent to others
    map       Algorithm 2 of the submaps, each condensed to its landmarks and the poses where pieces meet, and of what
              was heard of others; of its own alone where they do not go together

A closed piece that got a late row comes again with a higher version, and replaces.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from teamslam.errors import SolveError, TeamslamError
from teamslam.joining import Joined, build, condense, join
from teamslam.model import Dataset, Submap, is_landmark, is_pose, robot_of
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS


@dataclass(frozen=True, eq=False)
class Stretch:
    """The submaps of one closed stretch, whole and condensed, and why there is none of some of its parts."""

    version: int
    submaps: tuple[Submap, ...]
    condensed: tuple[Submap, ...]
    unbuilt: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Atlas:
    """The stretches of a robot's way by their number, and what was heard of others: their submaps, condensed."""

    stretches: Mapping[int, Stretch] = field(default_factory=lambda: MappingProxyType({}))
    heard: tuple[Submap, ...] = ()

    def with_stretch(
        self, number: int, version: int, pieces: Sequence[Dataset], end: int | None, options: Options = DEFAULTS
    ) -> "Atlas":
        """With the submaps of one stretch, given by the pieces of log that it is made of, up to the pose `end`; older
        than what is there, it changes nothing."""
        held = self.stretches.get(number)
        if held is not None and held.version >= version:
            return self
        submaps, unbuilt = [], []
        for piece in pieces:
            try:
                submaps.append(build(piece, version=version, options=options))
            except SolveError as error:
                unbuilt.append(str(error))
        small = tuple(_condensed(submap, end) for submap in submaps)
        stretch = Stretch(version, tuple(submaps), small, tuple(unbuilt))
        return replace(self, stretches=MappingProxyType({**self.stretches, number: stretch}))

    def with_heard(self, submaps: Sequence[Submap], robot: int) -> "Atlas":
        """With what others made, in place of what was heard before; of `robot`, whose atlas it is, nothing."""
        others = (submap for submap in submaps if robot not in submap.robots)
        return replace(self, heard=tuple(_condensed(submap, None, robot) for submap in others))

    @property
    def submaps(self) -> tuple[Submap, ...]:
        """All submaps, as they would be sent."""
        return tuple(submap for _, stretch in sorted(self.stretches.items()) for submap in stretch.submaps)

    @property
    def unbuilt(self) -> tuple[str, ...]:
        """Why pieces gave no submap."""
        return tuple(reason for _, stretch in sorted(self.stretches.items()) for reason in stretch.unbuilt)

    @cached_property
    def joined(self) -> Joined | None:
        """The map of the condensed submaps; None where there are none, or no map can be made of them."""
        own = [submap for _, stretch in sorted(self.stretches.items()) for submap in stretch.condensed]
        for submaps in ([*own, *self.heard], own):
            try:
                return join(submaps) if submaps else None
            except TeamslamError:
                continue
        return None

    def map_with(self, pose: int) -> Submap | None:
        """The part of the map that holds a pose."""
        if self.joined is None:
            return None
        return next((c.map for c in self.joined.components if pose in c.map.keys), None)


def _condensed(submap: Submap, end: int | None, robot: int | None = None) -> Submap:
    """What a map of landmarks needs of a submap: these, the pose `end`, poses of `robot`, and what raw rows name."""
    keys = submap.values.layout.keys
    named = [table.keys.ravel() for table in submap.raw]
    needed = is_landmark(keys) | np.isin(keys, np.concatenate([*named, [-1 if end is None else end]]))
    if robot is not None:
        needed |= is_pose(keys) & (robot_of(keys) == robot)
    try:
        return condense(submap, keys[needed])[0]
    except SolveError:  # an interior that only just holds: as it is
        return submap
