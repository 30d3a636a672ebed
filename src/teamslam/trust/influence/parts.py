"""The problem of a join at its optimum, cut into what each submap or each robot brings.

    F(G) = sum_k f_k(G)      f_k: a submap as one big measurement, or all that one robot brings, its raw rows included

At the optimum the slopes of all parts cancel, sum g_k = 0, and the information is their sum, H = sum H_k. That is all
that leaving a part out takes (see `downdate`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining.exact.gap import frame_of
from teamslam.joining.join.interiors import Member, members_of
from teamslam.joining.join.join import in_order
from teamslam.joining.join.optimum import usable_rows
from teamslam.model import WORLD, Submap, Table, Values, is_pose, pose_kind
from teamslam.solver import Condensed, Factor, Options, SubmapTerm, System, optimise

BENDS = 1.5  # times what a first step promises that the whole way may bring, as losses forgive more on it

Label = TypeVar("Label")
Contribution = tuple[Member, tuple[Table, ...]]


@dataclass(frozen=True, eq=False)
class Part:
    """What one contributor brings: `cost` f_k, `gradient` g_k (n,) = J'We and `information` H_k (n, n) over those of
    its unknowns that others touch as well, `at` (n,) in the whole problem; the rest is eliminated. `rows` counts what
    it measures beyond that."""

    cost: float
    gradient: Array
    information: Array
    at: IntArray
    rows: int


@dataclass(frozen=True, eq=False)
class Problem:
    """A join at its optimum `values`: its `members`, the raw rows `used` of each, the variables `fixed` that are its
    frame."""

    members: tuple[Member, ...]
    used: tuple[tuple[Table, ...], ...]
    values: Values
    fixed: IntArray

    @classmethod
    def of(cls, submaps: Sequence[Submap], joined: Submap) -> "Problem":
        """The problem of the map that some submaps were joined into; interiors are eliminated where that pays."""
        members = members_of(in_order(submaps))
        known = joined.all_values if joined.base >= 0 else joined.values  # systematic errors among them
        used = [tuple(usable_rows(member.joined.raw, known.layout)[0]) for member in members]
        return cls(tuple(members), tuple(used), known.only(_named(zip(members, used, strict=True))), frame_of(joined))

    @cached_property
    def system(self) -> System:
        """All of it."""
        return self._system(self._contributions, self.values)

    @cached_property
    def factor(self) -> Factor:
        """The factor of H: the only one that influences take."""
        factor = self.system.factor(self.values)
        factor.factorise(self.system.linearise(self.values).hessian.numbers)
        return factor

    @property
    def cost(self) -> float:
        """F: what joining costs, without what the submaps cost by themselves."""
        return self.system.cost(self.values)

    @property
    def dof(self) -> int:
        """Numbers measured without those that the unknowns took."""
        measured = sum(member.joined.values.layout.dof for member in self.members)
        measured += sum(table.dof for rows in self.used for table in rows)
        layout = self.values.layout
        known = layout.dofs[layout.index(self.fixed[layout.contains(self.fixed)])]
        return measured - (layout.dof - int(known.sum()))

    def parts(self, label: Callable[[Submap], Label]) -> dict[Label, Part]:
        """What each contributor brings: submaps of one label are one part, with the raw rows that travel with them."""
        groups: dict[Label, list[Contribution]] = {}
        for member, rows in self._contributions:
            groups.setdefault(label(member.whole), []).append((member, rows))
        touched = np.zeros(len(self.values), np.int64)
        for group in groups.values():
            touched[self.values.layout.index(_named(group))] += 1
        return {name: self._part(group, touched > 1) for name, group in groups.items()}

    def rest(self, stays: Callable[[Submap], bool]) -> "Rest | None":
        """The problem of the contributors that stay; None where they may not hold together, or are too few."""
        group = [(member, rows) for member, rows in self._contributions if stays(member.whole)]
        if len(group) < 2 or not len(self.fixed) or not tied([member.joined for member, _ in group]):
            return None
        values = self.values.only(np.unique(np.concatenate([member.joined.keys for member, _ in group])))
        used = tuple(tuple(usable_rows(rows, values.layout)[0]) for _, rows in group)
        frame = np.array([group[0][0].whole.base])  # any will do
        return Rest(Problem(tuple(member for member, _ in group), used, values, frame))

    @property
    def _contributions(self) -> list[Contribution]:
        return list(zip(self.members, self.used, strict=True))

    def _part(self, group: Sequence[Contribution], shared: BoolArray) -> Part:
        near = self.values.only(_named(group))
        system = self._system(group, near)
        at = system.linearise(near)
        known = shared[self.values.layout.index(system.free.keys)]
        # The part's own optimum over what only it touches: there the slope of the whole is the part's, and none.
        rest = Condensed(system.free, at.hessian.to_csr(), ~known, names=system.names)
        own = system.free.dof - rest.layout.dof
        return Part(
            cost=at.cost,
            gradient=at.gradient[system.free.unknowns(rest.layout.keys)],
            information=rest.information.toarray(),
            at=self.system.free.unknowns(rest.layout.keys),
            rows=system.rows - own,
        )

    def _system(self, group: Sequence[Contribution], values: Values) -> System:
        terms = [SubmapTerm.of(m.joined) for m, _ in group]
        tables = [table for _, rows in group for table in rows]
        fixed = self.fixed[values.layout.contains(self.fixed)]
        return System(values.layout, tables=tables, submaps=terms, fixed=fixed, names=self.members[0].whole.names)

    def moved(self, shift: Array) -> Values:
        """The values after a step (dof,) of the unknowns."""
        return self.system.retract(self.values, shift)


@dataclass(frozen=True, eq=False)
class Rest:
    """Some contributors by themselves, at values where all of them together are at their optimum."""

    problem: Problem

    @property
    def dof(self) -> int:
        """Numbers to spare."""
        return self.problem.dof

    def least(self) -> float:
        """What they cost at their own optimum at least, about: by one step towards it, which may promise too little."""
        system, values = self.problem.system, self.problem.values
        at = system.linearise(values)
        factor = system.factor(values)
        factor.factorise(at.hessian.numbers)
        return max(at.cost - BENDS * float(at.gradient @ factor.solve(at.gradient)), 0.0)

    def cost(self, options: Options) -> float:
        """What they cost at their own optimum near these values. Nothing else is made of it: it is quick."""
        return optimise(self.problem.system, self.problem.values, options).cost


def freed(submaps: Sequence[Submap], label: Callable[[Submap], Label]) -> dict[Label, int]:
    """How many of the numbers that a join has to spare go with each member (the submaps of one label), at least, by
    counting: what its submaps say beyond the unknowns that nobody else speaks of. 0 where the others may fall apart.

    Law: no more than the dof of the join less that of joining the others; as many, where nothing travels raw.
    """
    members = list(dict.fromkeys(label(submap) for submap in submaps))
    owner = np.array([members.index(label(submap)) for submap in submaps])
    frames = [0 if submap.base == WORLD else pose_kind(submap.base_dim).dof for submap in submaps]
    layouts = [submap.values.layout for submap in submaps]
    own = [len(layout) for layout in layouts]
    keys = np.concatenate([*(layout.keys for layout in layouts), [submap.base for submap in submaps]])
    dofs = np.concatenate([*(layout.dofs for layout in layouts), frames])
    holder = np.concatenate([np.repeat(np.arange(len(submaps)), own), np.arange(len(submaps))])
    _, first, variable = np.unique(keys, return_index=True, return_inverse=True)
    held = np.zeros((len(first), len(submaps)), bool)
    held[variable, holder] = True
    shared = np.flatnonzero(held.sum(1) > 1)
    ends = [keys[first[shared[held[shared, n]]]] for n in range(len(submaps))]
    by_member = np.stack([held[:, owner == n].any(1) for n in range(len(members))], 1)
    alone = by_member & (by_member.sum(1, keepdims=True) == 1)
    said = [sum(layouts[n].dof for n in np.flatnonzero(owner == member)) for member in range(len(members))]
    found = {}
    for number, name in enumerate(members):
        rest = [ends[n] for n in np.flatnonzero(owner != number).tolist()]
        count = said[number] - int(dofs[first[alone[:, number]]].sum()) - (max(frames) - min(frames))
        found[name] = max(count, 0) if rest and _hang_together(rest) else 0
    return found


def tied(submaps: Sequence[Submap]) -> bool:
    """Whether submaps surely hold together: each shares a pose, or three landmarks, with those before it."""
    return _hang_together([submap.keys for submap in submaps])


def _hang_together(ends: Sequence[IntArray]) -> bool:
    known, waiting = ends[0], list(ends[1:])
    while waiting:
        found = next((n for n, keys in enumerate(waiting) if _holds(np.intersect1d(known, keys))), None)
        if found is None:
            return False
        known = np.union1d(known, waiting.pop(found))
    return True


def _holds(shared: IntArray) -> bool:
    return bool(is_pose(shared).any()) or len(shared) > 2


def _named(group: Iterable[Contribution]) -> IntArray:
    """The variables that some submaps and their rows speak of."""
    named = [(member.joined.keys, *(table.keys.ravel() for table in rows)) for member, rows in group]
    return np.unique(np.concatenate([keys for each in named for keys in each]))
