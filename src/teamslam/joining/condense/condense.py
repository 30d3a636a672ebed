"""Condensed submaps: what others need to know of a submap, exactly, with the rest kept at home.

    I = [I_ss I_sb; I_bs I_bb]      s: separators, b: interiors, which nobody else knows

    condense   Lambda = I_ss - I_sb I_bb^-1 I_bs           joining (S^_s, Lambda) gives the joined map on s
    recover    e_b = -I_bb^-1 I_bs e_s,  S_b = S^_b (+) (-e_b), then composed with the submap's frame

The interiors' images h(X_1, .) are a bijection for every frame X_1, so the minimum over them is a Schur complement
exactly, not to first order: a map joined from condensed submaps is the joined map. What is dense need not be small:
a partial condensation eliminates interiors only while the message shrinks, and is as exact.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose
from teamslam.joining.condense.worth import worth_eliminating
from teamslam.model import Kind, Layout, Submap, Values, is_landmark
from teamslam.model.sparse import sp
from teamslam.solver import Condensed, SubmapTerm, System


def separators(submaps: Iterable[Submap], *, landmarks: bool = False) -> dict[str, IntArray]:
    """For each submap's id the variables (sorted keys) that others need: those that stand in another submap, as its
    frame or among its variables, those that anybody's raw measurements name, and its first pose, from which maps are
    seen. `landmarks`: all landmarks too."""
    submaps = list(submaps)
    known = [submap.keys for submap in submaps]
    raw = [np.unique(table.keys) for submap in submaps for table in submap.raw]
    keys, holders = np.unique(np.concatenate(known or [np.zeros(0, np.int64)]), return_counts=True)
    wanted = np.unique(np.concatenate([keys[holders > 1], *raw]))
    out = {}
    for submap in submaps:
        own = np.sort(submap.values.layout.keys)
        needed = np.isin(own, wanted) | (own == submap.first_pose)
        out[submap.id] = own[needed | is_landmark(own)] if landmarks else own[needed]
    return out


def condense(submap: Submap, keep: AnyArray) -> tuple[Submap, "Interior"]:
    """The submap on the variables `keep` alone, and the interior that can be recovered from a joined map.

    Laws: a join of condensed submaps equals the join of the whole ones on what was kept; `rows - dof` stays, since
    every interior unknown takes one measured number with it. Raises ModelError for keys that the submap does not
    have and for raw measurements of the submap that name an interior, SolveError where an interior is not determined.
    """
    gone = np.ones(len(submap.values), bool)
    gone[submap.values.layout.index(keep)] = False
    return _without(submap, gone)


def condense_partially(submap: Submap, keep: AnyArray) -> tuple[Submap, "Interior"]:
    """`condense`, but only of the interiors whose elimination makes the sparse message smaller.

    Interiors go in an order of least growth; of all stages the one with the fewest numbers is taken. So the result is
    never larger than the submap itself nor, but for the greedy order, than the condensed one.
    """
    gone = np.ones(len(submap.values), bool)
    gone[submap.values.layout.index(keep)] = False
    return _without(submap, worth_eliminating(submap.values.layout, submap.information, gone))


def _without(submap: Submap, gone: BoolArray) -> tuple[Submap, "Interior"]:
    layout = submap.values.layout
    for table in submap.raw:
        inside = layout.contains(table.keys)
        hidden = gone[layout.index(table.keys[inside])]
        if hidden.any():
            key = int(table.keys[inside][hidden][0])
            raise ModelError(
                f"submap {submap.id}: its raw {table.source} name {submap.names.describe(key)}, which would be "
                f"condensed away; keep what raw measurements name (teamslam.joining.separators does)"
            )
    interior = Interior(submap, layout.keys[gone])
    return interior.rest, interior


def condense_what_pays(submap: Submap, gone: BoolArray) -> tuple[Submap, "Interior"]:
    """The submap without those of the variables marked in `gone` (n,) whose elimination leaves fewer numbers, all
    together or group by group (cpp/condensation.hpp); raw measurements must not name them. Much quicker than
    `condense_partially`, which looks at each variable. Raises SolveError where an interior is not determined.
    """
    found = Condensed(submap.values.layout, submap.information, gone, frugal=True, names=submap.names)
    interior = Interior(submap, submap.values.layout.keys[found.gone], found)
    return interior.rest, interior


@dataclass(frozen=True, eq=False)
class Interior:
    """What stayed at home when `submap` was condensed: the variables `keys`, recoverable from a joined map."""

    submap: Submap
    keys: IntArray
    made: Condensed | None = field(default=None, repr=False)  # where it was eliminated already

    @cached_property
    def rest(self) -> Submap:
        """The submap without them."""
        kept = self.submap.values.select(~self._gone)
        return replace(
            self.submap,
            values=kept,
            information=self._condensed.information,
            rows=self.submap.rows - (self.submap.dof - kept.layout.dof),
        )

    def recover(self, joined: Submap) -> Values:
        """The interiors' estimate in the frame of the joined map: what joining the whole submap would have given.

        Raises ModelError where the joined map lacks the submap's base or one of the variables that were kept.
        """
        return self.recover_from(joined.all_values)

    def recover_from(self, known: Values) -> Values:
        """`recover`, from the joined estimate of at least the base and the variables that were kept."""
        layout = self.submap.values.layout
        missing = np.append(layout.keys[~self._gone], self.submap.base)
        missing = missing[~known.layout.contains(missing)]
        if len(missing):
            raise ModelError(
                f"the map does not hold {self.submap.names.describe(int(missing[0]))}, on which submap "
                f"{self.submap.id} hangs; recover interiors from a map that the submap was joined into"
            )
        if not len(self.keys):
            return self.submap.values.select(self._gone)
        frame = known.poses_of(np.array(self.submap.base), self.submap.base_dim)
        error = self.submap.values.select(~self._gone).minus(_seen_from(frame, known, layout.select(~self._gone)))
        return self.submap.values.select(self._gone).retract(self._condensed.follow(-error)).transform(frame)

    @cached_property
    def _gone(self) -> BoolArray:
        return np.isin(self.submap.values.layout.keys, self.keys)

    @cached_property
    def _condensed(self) -> Condensed:
        submap = self.submap
        return self.made or Condensed(submap.values.layout, submap.information, self._gone, names=submap.names)


def disagreement(submap: Submap, joined: Submap) -> Array:
    """e = S^ (-) h(G), (dof,): what a submap and a map that it was joined into disagree by, in the submap's frame.

    Raises ModelError where the map lacks a variable of the submap.
    """
    known = joined.all_values
    frame = known.poses_of(np.array(submap.base), submap.base_dim)
    return submap.values.minus(_seen_from(frame, known, submap.values.layout))


def _seen_from(frame: Pose, known: Values, layout: Layout) -> Values:
    """The variables of a layout as `known` has them, written in a frame."""
    back = frame.inverse()
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in Kind:
        if len(keys := layout.keys_of(kind)):
            local = back.lift(max(kind.dim, frame.dim))
            if kind.is_pose:
                parts[kind] = (keys, local @ known.poses_of(keys, kind.dim))
            else:
                parts[kind] = (keys, local.act(known.positions(keys, kind.dim)))
    return Values.of(parts)


def expand(joined: Submap, interiors: Sequence[Interior] | Mapping[str, Interior]) -> Submap:
    """The joined map with interiors put back, estimate and information.

    Law: the map that joining the whole submaps gives. The terms are linearised where they are recovered: what their
    elimination had left, J_s' Lambda J_s, is taken out, and the whole J' I J is put in.
    """
    held = list(interiors.values() if isinstance(interiors, Mapping) else interiors)
    values = joined.values
    for interior in held:
        values = values.update(interior.recover(joined))
    known = joined.all_values.update(values)
    pieces = [_placed(joined.information, joined.values.layout, values.layout)]
    for interior in held:
        members = known.only(interior.submap.keys)
        fixed = np.array([joined.base]) if members.layout.contains(joined.base) else np.zeros(0, np.int64)
        system = System(members.layout, submaps=[SubmapTerm.of(interior.submap)], fixed=fixed)
        whole = system.linearise(members).hessian.to_csr()
        rest = Condensed(system.free, whole, np.isin(system.free.keys, interior.keys))
        pieces.append(_placed(whole, system.free, values.layout))
        pieces.append(-_placed(rest.information, rest.layout, values.layout))
    return replace(
        joined,
        values=values,
        information=sp.csr_array(sum(pieces[1:], start=pieces[0])),
        rows=joined.rows + values.layout.dof - joined.dof,
    )


def _placed(matrix: sp.csr_array, layout: Layout, into: Layout) -> sp.csr_array:
    """A matrix over the unknowns of one layout as one over those of a larger."""
    at = into.unknowns(layout.keys)
    coo = sp.coo_array(matrix)
    return sp.csr_array((coo.data, (at[coo.row], at[coo.col])), shape=(into.dof, into.dof))
