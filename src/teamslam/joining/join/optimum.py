"""The optimum of a join from one assembly of its members' frames, as a solution and as a map.

The solver works on what is shared; H over everything, interiors put back, is made when somebody asks for it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray, Pose
from teamslam.joining.join.gauge import anchor, in_the_world, surveyed
from teamslam.joining.join.homes import homes
from teamslam.joining.join.interiors import Member, restored
from teamslam.joining.join.start_values import start_values
from teamslam.joining.place.stack import Stack
from teamslam.joining.start.adrift import adrift
from teamslam.joining.start.elsewhere import elsewhere, while_lower
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import WORLD, Layout, Names, Sources, Submap, Table, Values, is_landmark
from teamslam.solver import Options, Solution, Status, Step, SubmapTerm, System, convex_start, reach

A_LOOK = 100  # iterations: no more are asked for where an optimum is not
NOBODY = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Optimum:
    """`shared`: the solution for what is shared, from the raw rows `used` and with the variables `fixed` held; rows
    that were set `aside` wait, though all that they name is there."""

    members: Sequence[Member]
    shared: Solution
    used: Sequence[Table]
    fixed: IntArray
    names: Names
    aside: tuple[Table, ...] = ()

    @classmethod
    def of(
        cls,
        members: Sequence[Member],
        frames: Sequence[Pose],
        options: Options,
        progress: Callable[[Step], None] | None,
        known: Values | None = None,
    ) -> "Optimum":
        """The optimum from these frames of the members, and from there again with landmarks that only raw rows hold put
        where what sees them costs less, while that gains; they are sought first from where they are `known` to be, else
        where these frames put them."""
        first = cls._first(members, frames, options, progress, known)
        stack, used, fixed = Stack.of([member.joined for member in members]), first.used, first.fixed
        held = np.append(stack.keys, fixed)
        return while_lower(
            first,
            lambda found: found.shared,
            lambda found: elsewhere(found.shared.values, used, held),
            lambda other: cls._from(members, stack, other, used, fixed, options, progress),
        )

    @classmethod
    def _first(
        cls,
        members: Sequence[Member],
        frames: Sequence[Pose],
        options: Options,
        progress: Callable[[Step], None] | None,
        known: Values | None,
    ) -> "Optimum":
        """The optimum from these frames of the members, and where landmarks are `known` to be.

        A landmark that only raw rows hold, and with which there is no solution, is not among what is shared: its rows
        wait. One that the start could not place is looked for again at the optimum, and so are those that were in the
        way on the way there.
        """
        submaps = [member.joined for member in members]
        raw = [table for submap in submaps for table in submap.raw]
        stack = Stack.of(submaps)
        begun = _with_landmarks(start_values(stack, frames), known, raw)
        start, loose, world = triangulate(begun, raw), np.zeros(0, np.int64), True
        without: Optimum | None = None  # the landmarks that were in the way
        while True:
            usable, _ = usable_rows(raw, start.layout, world=world)
            anchored, fixed, used = anchor(start, submaps[0], usable)
            start = less(surveyed(anchored, raw), loose) if in_the_world(fixed) else anchored
            if len(start) > len(anchored):
                continue
            try:
                found = cls._from(members, stack, start, used, fixed, options, progress)
            except SolveError as error:
                if without is not None:
                    return without
                if not world or len(fixed) or is_landmark(error.key or 0):
                    start = less(start, loose := np.append(loose, in_the_way(start, error, stack.keys, used)))
                else:  # positions that looked apart are not: the map is free to turn in the world
                    start, world = less(triangulate(begun, raw), loose), False
                continue
            if without is not None:
                return found if found.shared.converged else without
            gone = (
                np.setdiff1d(adrift(found.shared.values, used, settled=False), stack.keys) if found.in_vain else NOBODY
            )
            if len(gone):
                start, loose = less(start, gone), np.append(loose, gone)
                continue
            start = less(triangulate(found.shared.values, raw), loose)
            if len(start) == len(anchored):
                if not len(loose):
                    return found
                without, start = found, triangulate(found.shared.values, raw)
                if len(start) == len(anchored):
                    return found

    @classmethod
    def near(
        cls, members: Sequence[Member], start: Values, used: Sequence[Table], fixed: IntArray, options: Options
    ) -> "Optimum":
        """The optimum from a start that holds at least what is shared and what the raw rows `used` name."""
        stack = Stack.of([member.joined for member in members])
        named = np.concatenate([stack.keys, stack.bases, *(table.keys.ravel() for table in used)])
        start = start.select(np.isin(start.layout.keys, named))
        return cls._from(members, stack, start, used, fixed, options, None)

    @classmethod
    def _from(
        cls,
        members: Sequence[Member],
        stack: Stack,
        start: Values,
        used: Sequence[Table],
        fixed: IntArray,
        options: Options,
        progress: Callable[[Step], None] | None,
    ) -> "Optimum":
        submaps = [member.joined for member in members]
        names = submaps[0].names.merge(m.names for m in submaps[1:])
        terms = [SubmapTerm.of(submap) for submap in submaps]
        carried = homes(start.layout, stack)
        system = System(start.layout, tables=used, submaps=terms, fixed=fixed, names=names, homes=carried)
        solution = reach(system, convex_start(system, start, options), options, progress)
        return cls(members, solution, used, fixed, names)

    @property
    def cost(self) -> float:
        """What the map costs: the submaps' own costs, and what joining them adds."""
        return self.shared.cost + sum(member.whole.cost for member in self.members)

    @property
    def stopped(self) -> bool:
        """Whether the search ended short of an optimum, where no step led on."""
        return self.shared.status is Status.STUCK

    @property
    def in_vain(self) -> bool:
        """Whether the search did not end at an optimum, though it was not meant as a look alone."""
        return not self.shared.converged and (self.stopped or self.shared.iterations > A_LOOK)

    @cached_property
    def solution(self) -> Solution:
        """The solution with all interiors put back: what joining the whole submaps gives."""
        if all(member.interior is None for member in self.members):
            return self.shared
        values = restored(self.members, self.shared.values)
        terms = [SubmapTerm.of(member.whole) for member in self.members]

        def system() -> System:
            return System(values.layout, tables=self.used, submaps=terms, fixed=self.fixed, names=self.names)

        return replace(
            self.shared,
            values=values,
            rows=self.shared.rows + sum(member.whole.dof - member.joined.dof for member in self.members),
            made=lambda: system().linearise(values).hessian,
        )

    def map(self, base_dim: int) -> Submap:
        """The joined map, in a frame of this dimension."""
        wholes = [member.whole for member in self.members]
        map = joined_map(wholes, self.used, self.solution, self.fixed, self.names, base_dim)
        return replace(map, raw=(*map.raw, *self.aside)) if self.aside else map


def _with_landmarks(values: Values, known: Values | None, tables: Iterable[Table]) -> Values:
    """The values with those landmarks of rows that they lack and that are known."""
    if known is None:
        return values
    named = np.concatenate([NOBODY, *(table.keys.ravel() for table in tables)])
    keys = np.setdiff1d(known.layout.keys[np.isin(known.layout.keys, named)], values.layout.keys)
    return values.update(known.only(keys)) if len(keys) else values


def in_the_way(values: Values, error: SolveError, held: IntArray, tables: Iterable[Table]) -> IntArray:
    """The landmarks, none of them among `held`, without which there may be a solution, so that they cost nobody else
    anything: the one that turned out to be open; of a pose that did, or a landmark that is held, those that `tables`
    tie to it, else all of them.

    Raises the error again where there are none.
    """
    keys = values.layout.keys
    bare = keys[is_landmark(keys) & (keys != WORLD) & ~np.isin(keys, held)]
    if error.key is None or not len(bare):
        raise error
    tied = [t.keys[(t.keys == error.key).any(1)].ravel() for t in tables]
    nearest = bare[bare == error.key] if error.key in bare else np.intersect1d(bare, np.concatenate(tied))
    return nearest if len(nearest) else bare


def less(values: Values, keys: IntArray) -> Values:
    """The values without some of their variables, so that the rows of these wait."""
    return values.select(~np.isin(values.layout.keys, keys))


def usable_rows(raw: Iterable[Table], layout: Layout, *, world: bool = True) -> tuple[list[Table], list[Table]]:
    """Raw measurements in two parts: those whose variables are all there, and those that wait for another submap; where
    the map is not written in the `world`'s frame, what was measured in it waits too."""
    usable, waiting = [], []
    for table in raw:
        ready = np.asarray(table.told_by(layout) & (world or not table.row.unary))
        if ready.all():
            usable += [table] if len(table) else []
            continue
        usable += [table.select(ready)] if ready.any() else []
        waiting.append(table.select(~ready))
    return usable, waiting


def joined_map(
    members: Sequence[Submap],
    raw: Sequence[Table],
    solution: Solution,
    fixed: IntArray,
    names: Names,
    base_dim: int,
) -> Submap:
    """The joined map as a submap, in the frame of the fixed pose (or the world's)."""
    tables = [t for m in members for t in m.raw]
    _, waiting = usable_rows(tables, solution.values.layout, world=in_the_world(fixed))
    keep = ~np.isin(solution.values.layout.keys, fixed)
    return Submap(
        id="+".join(sorted(m.id for m in members)),
        version=max(m.version for m in members),
        base=int(fixed[0]) if len(fixed) else WORLD,
        base_dim=base_dim,
        values=solution.values.select(keep),
        information=lambda: solution.information,
        sources=Sources().merge(*(m.sources for m in members)),
        names=names,
        raw=tuple(waiting),
        cost=solution.cost + sum(m.cost for m in members),
        chi2=solution.chi2 + sum(m.chi2 for m in members),
        rows=sum(m.rows for m in members) + sum(t.dof for t in raw),
    )
