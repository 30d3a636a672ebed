"""Condensed submaps: what others need to know of a submap, exactly, with the rest kept at home.

    I = [I_ss I_sb; I_bs I_bb]      s: separators, b: interiors, which nobody else knows

    condense   Lambda = I_ss - I_sb I_bb^-1 I_bs           joining (S^_s, Lambda) gives the joined map on s
    recover    e_b = -I_bb^-1 I_bs e_s,  S_b = S^_b (+) (-e_b), then composed with the submap's frame

The interiors' images h(X_1, .) are a bijection for every frame X_1, so the minimum over them is a Schur complement
exactly, not to first order: a map joined from condensed submaps is the joined map. What is dense need not be small:
a partial condensation eliminates interiors only while the message shrinks, and is as exact.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose
from teamslam.joining.condense.worth import block_couplings, worth_eliminating
from teamslam.model import Kind, Layout, Submap, Values, is_landmark
from teamslam.solver import Factor, SubmapTerm, System, block_matrix


def separators(submaps: Iterable[Submap], *, landmarks: bool = False) -> dict[str, IntArray]:
    """For each submap's id the variables (sorted keys) that others need: those that stand in another submap, as its
    frame or among its variables, and those that anybody's raw measurements name. `landmarks`: all landmarks too."""
    submaps = list(submaps)
    known = [submap.keys for submap in submaps]
    raw = [np.unique(table.keys) for submap in submaps for table in submap.raw]
    keys, holders = np.unique(np.concatenate(known or [np.zeros(0, np.int64)]), return_counts=True)
    wanted = np.unique(np.concatenate([keys[holders > 1], *raw]))
    out = {}
    for submap in submaps:
        own = np.sort(submap.values.layout.keys)
        needed = np.isin(own, wanted)
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
    kept = submap.values.select(~gone)
    small = replace(
        submap,
        values=kept,
        information=schur_complement(layout, submap.information, gone),
        rows=submap.rows - (submap.dof - kept.layout.dof),
    )
    return small, Interior(submap, layout.keys[gone])


def schur_complement(layout: Layout, information: sp.csr_array, gone: BoolArray) -> sp.csr_array:
    """I_ss - I_sb I_bb^-1 I_bs, sparse, over the variables that are not `gone` (n,), in the order of the layout.

    Interiors that do not touch each other are eliminated apart from each other, so only what each group of them
    connects fills in. Raises SolveError where an interior is not determined by the rest.
    """
    unknown_gone = np.repeat(gone, layout.dofs)
    stays = np.flatnonzero(~unknown_gone)
    place = np.cumsum(~unknown_gone) - 1
    parts = [sp.coo_array(information[stays][:, stays])]
    for group, edge in _groups(layout, information, gone):
        members = np.sort(np.concatenate([group, edge]))
        local = layout.select(np.isin(np.arange(len(layout)), members))
        unknowns = _unknowns(layout, members)
        matrix = sp.coo_array(information[unknowns][:, unknowns])
        last = np.flatnonzero(~gone[members])
        inner = np.repeat(gone[members], local.dofs)
        touches = inner[matrix.row] | inner[matrix.col]
        matrix = sp.coo_array((matrix.data[touches], (matrix.row[touches], matrix.col[touches])), shape=matrix.shape)
        pattern, numbers = block_matrix(local, sp.csr_array(matrix))
        change, _ = Factor(local, pattern, last=last).eliminate(numbers, np.zeros(local.dof))
        at = place[_unknowns(layout, edge)]
        rows, columns = np.meshgrid(at, at, indexing="ij")
        change = 0.5 * (change + change.T)
        parts.append(sp.coo_array((change.ravel(), (rows.ravel(), columns.ravel())), shape=(len(stays), len(stays))))
    data, rows, columns = (np.concatenate([getattr(p, name) for p in parts]) for name in ("data", "row", "col"))
    return sp.csr_array(sp.coo_array((data, (rows, columns)), shape=(len(stays), len(stays))))


def _groups(layout: Layout, information: sp.csr_array, gone: BoolArray) -> list[tuple[IntArray, IntArray]]:
    """The groups of interiors that hang together, each with the kept variables that it touches: places, rising."""
    from scipy.sparse.csgraph import connected_components

    couplings = block_couplings(layout, information)
    inner = np.flatnonzero(gone)
    if not len(inner):
        return []
    count, label = connected_components(couplings[inner][:, inner], directed=False)
    edges = sp.coo_array(couplings[inner])
    outward = ~gone[edges.col]
    pairs = np.unique(np.stack([label[edges.row[outward]], edges.col[outward]], -1), axis=0)
    order = np.argsort(label, kind="stable")
    groups = np.split(inner[order], np.flatnonzero(np.diff(label[order])) + 1)
    touched = np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, count)))
    return [(group, np.asarray(edge, np.int64)) for group, edge in zip(groups, touched, strict=True) if len(edge)]


def _unknowns(layout: Layout, places: IntArray) -> IntArray:
    return layout.unknowns(layout.keys[places])


@dataclass(frozen=True, eq=False)
class Interior:
    """What stayed at home when `submap` was condensed: the variables `keys`, recoverable from a joined map."""

    submap: Submap
    keys: IntArray

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
        shift = self._factor.solve(self._coupling @ error)  # -e_b
        return self.submap.values.select(self._gone).retract(shift).transform(frame)

    @cached_property
    def _gone(self) -> BoolArray:
        return np.isin(self.submap.values.layout.keys, self.keys)

    @cached_property
    def _coupling(self) -> sp.csr_array:
        unknown_gone = np.repeat(self._gone, self.submap.values.layout.dofs)
        inner, outer = np.flatnonzero(unknown_gone), np.flatnonzero(~unknown_gone)
        return sp.csr_array(self.submap.information[inner][:, outer])

    @cached_property
    def _factor(self) -> Factor:
        layout = self.submap.values.layout
        inner = np.flatnonzero(np.repeat(self._gone, layout.dofs))
        matrix = sp.csr_array(self.submap.information[inner][:, inner])
        return Factor.of(layout.select(self._gone), matrix, self.submap.names)


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
        gone = np.isin(system.free.keys, interior.keys)
        rest = schur_complement(system.free, whole, gone)
        pieces.append(_placed(whole, system.free, values.layout))
        pieces.append(-_placed(rest, system.free.select(~gone), values.layout))
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
