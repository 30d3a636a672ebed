"""How far a join is from the full least squares, though nobody holds all raw data: a round in which nobody moves.

The paper's join replaces each submap's cost f_i by its quadratic at the submap's own optimum. What that costs is seen
where the join ended, at G:

    robot:        f_i, g_i = grad f_i, H_i = J'WJ of its raw measurements at h_i(G)
    coordinator:  F = sum f_i,   the Gauss-Newton step d of the whole F at G,   g'd = |grad F|^2_(H^-1)

g'd is the decrease of F that the step promises; against F it is the relative cost gap. A join that is exact promises
none. `exact_join` goes on from here, round by round, until nothing is promised.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, IntArray
from teamslam.joining.exact import Part, separators_of
from teamslam.joining.join import Component, Exactness, Joined, usable_rows
from teamslam.model import Dataset, Sources, Submap
from teamslam.solver import Factor, SubmapTerm, System


def with_exactness(joined: Joined, members: Sequence[tuple[Dataset, Submap]]) -> Joined:
    """A join that knows how exact it is: pairs of a piece of log and the submap that was built of it, in any order.

    A component of which some piece is missing stays without, and so does one whose problem is not determined where it
    ended. Law: the gap is that to `full` on the same data, to first order in it and, under robust losses, of its size;
    `rounds` is 1 and `bytes` what that round takes.
    """
    return replace(joined, components=tuple(_with_exactness(component, members) for component in joined.components))


def _with_exactness(component: Component, members: Sequence[tuple[Dataset, Submap]]) -> Component:
    if component.exactness is not None:
        return component
    here = [(piece, submap) for piece, submap in members if component.map.sources.overlap(submap.sources)]
    if Sources().merge(*(submap.sources for _, submap in here)) != component.map.sources:
        return component
    try:
        return replace(component, exactness=_exactness(component.map, here))
    except SolveError:
        return component


def _exactness(joined: Submap, members: Sequence[tuple[Dataset, Submap]]) -> Exactness:
    values = joined.all_values if joined.base >= 0 else joined.values
    fixed = np.array([b for b in (joined.base,) if b >= 0], np.int64)
    submaps = [submap for _, submap in members]
    raw, _ = usable_rows([t for s in submaps for t in s.raw], values.layout)
    separators = separators_of(submaps, raw)
    terms, cost, numbers = [], 0.0, 0
    for piece, submap in members:
        part = Part(piece, submap, separators)
        part.values = values.seen_from(values.pose(submap.base), part.values.layout)
        numbers += part.reduce().numbers + len(part.separators.state)
        at = part.system.linearise(part.values)
        own = part.values.only(part.system.free.keys)
        terms.append(SubmapTerm(submap.base, own, at.hessian.to_csr(), at.gradient))
        cost += at.cost
    system = System(values.layout, tables=raw, submaps=terms, fixed=fixed, names=joined.names)
    at = system.linearise(values)
    factor = Factor.of(system.free, at.hessian, joined.names)
    step = factor.solve(at.gradient)
    promised = max(float(at.gradient @ step), 0.0)
    cost += sum(float(t.loss.cost(np.sum(t.whitened(values) ** 2, -1)).sum()) for t in raw)
    return Exactness(
        relative_cost_gap=promised / cost if cost > 0.0 else 0.0,
        gradient_norm=float(np.sqrt(promised)),
        max_shift_sigma=float(_sigmas(step, system.free.dof_start, factor.marginals()).max(initial=0.0)),
        join_shift_sigma=0.0,
        rounds=1,
        bytes=8 * numbers if len(members) > 1 else 0,
    )


def _sigmas(shift: Array, starts: IntArray, covariances: Sequence[Array]) -> Array:
    """The length of each variable's shift in its own standard deviations."""
    parts = [shift[starts[n] : starts[n + 1]] for n in range(len(covariances))]
    squares = [float(d @ np.linalg.solve(c, d)) for d, c in zip(parts, covariances, strict=True)]
    return np.sqrt(np.maximum(squares, 0.0))
