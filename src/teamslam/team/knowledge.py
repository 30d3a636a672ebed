"""What others know, by name alone: which landmarks and whose poses each robot has in its submaps.

It is told in pages, each a set of at most `PAGE` keys that only grows; a page that is full never changes, so what a
robot tells in all is little more than what is new. Merging is union, so it does not matter in which order pages come,
or how often: a join-semilattice, as `SubmapSet` is.

A robot needs it for two things: to have a pose wherever another saw it, and to keep, of a submap that it sends in
short, what somebody else knows too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import is_landmark, robot_of
from teamslam.model.keys import is_unnamed

PAGE = 256  # keys


@dataclass(frozen=True)
class Page:
    """A page of a robot's announcements: its newest version, which is how many keys it has, and its keys."""

    version: int
    keys: frozenset[int]

    def merge(self, other: "Page") -> "Page":
        """Both."""
        return Page(max(self.version, other.version), self.keys | other.keys)


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Pages by robot and number."""

    pages: Mapping[tuple[int, int], Page] = field(default_factory=lambda: MappingProxyType({}))

    def merge(self, other: "Knowledge") -> "Knowledge":
        """What both know together."""
        pages = dict(self.pages)
        for name, theirs in other.pages.items():
            pages[name] = pages[name].merge(theirs) if name in pages else theirs
        return Knowledge(MappingProxyType(pages))

    def of(self, robot: int) -> frozenset[int]:
        """What a robot told."""
        return frozenset[int]().union(*(page.keys for (who, _), page in self.pages.items() if who == robot))

    def beside(self, robot: int) -> IntArray:
        """The keys that robots other than this one know, rising."""
        return np.array(sorted(self._holders.keys() - self._only(robot)), np.int64)

    def poses_of(self, robot: int) -> IntArray:
        """The poses of a robot that others know, rising."""
        keys = self.beside(robot)
        return np.asarray(keys[robot_of(keys) == robot])

    def with_more(self, robot: int, keys: IntArray) -> "Knowledge":
        """The pages that are new or longer once a robot knows these keys as well: the last one is filled up, then new
        ones begun. Names that were given to nobody (`is_unnamed`) nobody else can know."""
        said = self.of(robot)
        fresh = [key for key in np.unique(_tellable(robot, keys)).tolist() if key not in said]
        number = max((page for who, page in self.pages if who == robot), default=0)
        pages: dict[tuple[int, int], Page] = {}
        while fresh:
            before = self.pages[robot, number].keys if (robot, number) in self.pages else frozenset[int]()
            more, fresh = fresh[: PAGE - len(before)], fresh[PAGE - len(before) :]
            if more:
                pages[robot, number] = Page(len(before) + len(more), before | frozenset(more))
            number += 1
        return Knowledge(MappingProxyType(pages))

    @cached_property
    def _holders(self) -> Mapping[int, frozenset[int]]:
        """Who knows each key."""
        holders: dict[int, set[int]] = {}
        for (robot, _), page in self.pages.items():
            for key in page.keys:
                holders.setdefault(key, set()).add(robot)
        return {key: frozenset(robots) for key, robots in holders.items()}

    def _only(self, robot: int) -> set[int]:
        return {key for key, robots in self._holders.items() if robots == {robot}}


def _tellable(robot: int, keys: IntArray) -> IntArray:
    """Landmarks that have a name, and the poses of other robots."""
    marks = is_landmark(keys) & ~is_unnamed(keys)
    return np.asarray(keys[marks | (robot_of(keys) > 0) & (robot_of(keys) != robot)])
