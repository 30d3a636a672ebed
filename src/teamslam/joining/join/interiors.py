"""What nobody else knows is eliminated before a join, and put back after it.

    min over b of |S^ (-) h(G)|^2_I  =  |S^_s (-) h_s(G)|^2_Lambda        s: shared, b: interiors, exactly (`condense`)

So a join iterates on what is shared alone, and the map that it ends with is the map. This pays where interiors are the
larger part of a submap and many: a few of them cost more to take out than to carry along.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.condense.condense import Interior, condense_what_pays
from teamslam.joining.place.stack import Stack
from teamslam.model import Submap, Values
from teamslam.model.layout import KIND_DOF
from teamslam.solver import side_by_side

LEAST = 100  # unknowns of a submap's interiors from which on their elimination pays


@dataclass(frozen=True, eq=False)
class Member:
    """A submap in a join: `whole`, and what of it is joined, where that is less."""

    whole: Submap
    interior: Interior | None = None

    @property
    def joined(self) -> Submap:
        """What is joined of it."""
        return self.whole if self.interior is None else self.interior.rest


def members_of(submaps: Sequence[Submap]) -> list[Member]:
    """The submaps, each without the interiors whose elimination pays."""
    most = np.array([max(len(submap.values.state) for submap in submaps)])  # no submap has more unknowns
    if (len(submaps) == 1 and not submaps[0].raw) or not worth_it(most, most).any():
        return [Member(submap) for submap in submaps]
    stack = Stack.of(submaps)
    inner = ~np.isin(stack.keys, shared_keys(stack, submaps))
    dofs, count = KIND_DOF[stack.kinds], len(submaps)
    inside, unknowns = (np.bincount(stack.holder, of, count).astype(np.int64) for of in (dofs * inner, dofs))
    pays = np.flatnonzero(worth_it(inside, unknowns)).tolist()
    found = [Member(submap) for submap in submaps]
    spared = side_by_side(lambda n: _without_interiors(submaps[n], inner[stack.holder == n]), pays)
    for number, member in zip(pays, spared, strict=True):
        found[number] = member
    return found


def worth_it(inside: IntArray, unknowns: IntArray) -> BoolArray:
    """Whether eliminating interiors pays, in submaps with so many unknowns inside, of so many in all."""
    return np.asarray((inside >= LEAST) & (2 * inside > unknowns))


def shared_keys(stack: Stack, submaps: Sequence[Submap]) -> IntArray:
    """The variables that more than one of the stacked submaps knows, its frame included, or that raw rows name; and
    their first poses, one of which is the map's frame."""
    keys, known = np.unique(np.concatenate([stack.keys, stack.bases]), return_counts=True)
    raw = [table.keys.ravel() for submap in submaps for table in submap.raw]
    return np.concatenate([keys[known > 1], stack.first_poses, *raw])


def _without_interiors(submap: Submap, inner: BoolArray) -> Member:
    try:
        _, interior = condense_what_pays(submap, inner)
    except SolveError:
        return Member(submap)  # a variable is not determined: the join, should there be one, names it
    return Member(submap, interior) if len(interior.keys) else Member(submap)


def restored(members: Sequence[Member], joined: Values) -> Values:
    """The joined estimate with all interiors put back."""
    inside = [m.interior.recover_from(joined) for m in members if m.interior is not None]
    return Values.together([joined, *inside]) if inside else joined
