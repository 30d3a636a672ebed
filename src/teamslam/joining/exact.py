"""Joining that is exact: rounds of one Gauss-Newton step, in which robots send only their reduced information.

Every measurement belongs to one submap and does not care about frames, so the full cost is F(G) = sum_i f_i(h_i(G))
exactly. The paper's join replaces f_i by its quadratic at the local optimum. Here each round renews that quadratic
where the team is:

    robot:        at its point S_i: H = J'WJ, g = J'We, f; interiors eliminated: (Lambda, eta, f) over its separators
    coordinator:  e = S^ (-) h(G), one step of sum |e|^2_Lambda + 2 eta'e, and sends the separators' new places back
    robot:        interiors follow, d_b = H_bb^-1 (g_b - H_bs d_s), and it linearises anew

The first round is the paper's join. From then on this is Gauss-Newton on F by nested dissection, so its fixed point
is grad F = 0: the full nonlinear least squares, though nobody holds all raw data. F is a sum of scalars, so a step
that raises it is known, and halved. What is left is known too: the Newton decrement adds up from the robots' parts.
Where it falls slowly, robots and coordinator take in how residuals bend (solver.newton), and the rounds are Newton's.
Rounding of F hides the last of them; they go on while the decrement falls.

A submap whose separators are so many that their dense matrix is larger than its own sparse one sends the sparse one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining.build import build_choices, gaussian_part
from teamslam.joining.choose import lowest
from teamslam.joining.join import (
    Component,
    Exactness,
    Joined,
    in_order,
    join,
    joined_map,
    refuse_double_counting,
    usable_rows,
)
from teamslam.model import Dataset, Submap, Table, Values
from teamslam.solver import Factor, Options, Solution, Status, Step, SubmapTerm, System
from teamslam.solver.newton import Bend, Curvature
from teamslam.solver.optimise import DEFAULTS

UNSEEN = 1e-12  # of F: what its rounding hides
FALLS = 0.9  # the decrement that falls less than to this, where F shows nothing any more, is rounding itself
LEAST_SHARE = 1e-4  # of a step
SLOW = 0.25  # as in Bend; a round costs messages, curvature costs none


@dataclass(frozen=True, eq=False)
class Reduced:
    """What a robot sends in a round: information and slope over its separators, its cost, its interiors'
    decrement^2."""

    information: sp.csr_array
    slope: Array
    cost: float
    interior: float
    numbers: int


class Part:
    """One submap's side of the rounds: it keeps its raw measurements and its interiors to itself."""

    def __init__(self, piece: Dataset, submap: Submap, separators: IntArray) -> None:
        self.submap = submap
        robot = piece.tables[0].robot
        own = submap.trajectory_keys(robot)
        self.values = submap.all_values
        inside, _ = gaussian_part(piece.tables, robot, own, self.values.layout)
        self.system = System(self.values.layout, tables=inside, fixed=np.array([submap.base]), names=piece.names)
        free = self.system.free
        keep = np.isin(free.keys, separators)
        dense = int(free.dofs[keep].sum())
        whole = submap.information.nnz
        self.sends_whole = dense == 0 or dense * dense >= whole
        self.keep: BoolArray = np.ones(len(free), bool) if self.sends_whole else keep
        self.kept = free.select(self.keep)
        self._columns = free.unknowns(self.kept.keys)
        last = None if self.sends_whole else np.flatnonzero(self.keep)
        self._factor = Factor(free, self.system.pattern, last=last, names=piece.names)
        self._gradient = np.zeros(free.dof)

    @property
    def separators(self) -> Values:
        """The estimate of what is sent, in the submap's frame."""
        return self.values.only(self.kept.keys)

    def reduce(self, curvature: Curvature = "none") -> Reduced:
        """Linearise at the present point and eliminate the interiors; `curvature` as in System.linearise."""
        at = self.system.linearise(self.values, curvature=curvature)
        self._gradient = at.gradient
        if self.sends_whole:
            whole = at.hessian.to_csr()
            numbers = sp.triu(whole).nnz + 2 * self.kept.dof + 1
            return Reduced(whole, at.gradient, at.cost, 0.0, numbers)
        complement, slope = self._factor.eliminate(at.hessian.numbers, at.gradient)
        n = self.kept.dof
        at_rest = self._factor.back_substitute(np.zeros(n), at.gradient)
        interior = float(at.gradient @ at_rest)
        return Reduced(_dense(complement), slope, at.cost, interior, n * (n + 1) // 2 + 2 * n + 1)

    def follow(self, separators: Values) -> Values:
        """The robot's estimate after its separators moved there; interiors go where the quadratic has its least."""
        shift = separators.minus(self.values.only(self.kept.keys))
        if self.sends_whole:
            delta = np.zeros(self.system.free.dof)
            delta[self._columns] = shift
        else:
            delta = self._factor.back_substitute(shift, self._gradient)
        return self.system.retract(self.values, delta)


def _dense(complement: Array) -> sp.csr_array:
    """A dense block as a sparse matrix that keeps its zeros: its structure must not change between rounds."""
    n = len(complement)
    symmetric = 0.5 * (complement + complement.T)
    return sp.csr_array((symmetric.ravel(), np.tile(np.arange(n), n), np.arange(0, n * n + 1, n)), shape=(n, n))


def exact_join(
    pieces: Sequence[Dataset],
    *,
    gap: float = 1e-20,
    max_rounds: int = 300,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Joined:
    """The join of the submaps of all pieces, in rounds until it is the full least squares.

    Stops when the decrease of F still to be had is below `gap` of F, or rounding is all that is left of it. Every
    component carries its `exactness`; one that did not get there within `max_rounds` says so in its status. Law: the
    estimate is that of `full` on the same data. Raises as `build` and `join` do.
    """
    alternatives = [build_choices(piece, options=options) for piece in pieces]
    raw_of = {found[0].id: piece for piece, found in zip(pieces, alternatives, strict=True)}
    refuse_double_counting(in_order(found[0] for found in alternatives))
    rough = replace(options, decrement=max(options.decrement, 1e-3))

    def solve(submaps: Sequence[Submap]) -> Joined:
        built = {submap.id: (raw_of[submap.id], submap) for submap in submaps}
        first = join(submaps, options=rough)
        components = (
            _rounds(c, [built[name] for name in c.members], gap, max_rounds, options, progress)
            for c in first.components
        )
        return Joined(tuple(components), first.reasons)

    return lowest(alternatives, solve)


def separators_of(submaps: Sequence[Submap], raw: Sequence[Table]) -> IntArray:
    """The keys that more than one submap knows (bases among them), or that raw measurements name."""
    everywhere = np.concatenate([np.unique(s.keys) for s in submaps])
    keys, times = np.unique(everywhere, return_counts=True)
    return np.union1d(keys[times > 1], np.concatenate([t.keys.ravel() for t in raw] or [np.zeros(0, np.int64)]))


def _rounds(
    component: Component,
    members: Sequence[tuple[Dataset, Submap]],
    gap: float,
    max_rounds: int,
    options: Options,
    progress: Callable[[Step], None] | None,
) -> Component:
    submaps = [submap for _, submap in members]
    joined = component.map
    start = joined.all_values if not joined.base < 0 else joined.values
    raw, _ = usable_rows([t for s in submaps for t in s.raw], start.layout)
    separators = separators_of(submaps, raw)
    parts = [Part(piece, submap, separators) for piece, submap in members]
    team = _Team(parts, raw, start, joined)
    return team.run(component, gap, max_rounds, progress)


@dataclass(frozen=True, eq=False)
class _Ahead:
    """What a round found: F here, the step, the decrease of F that it promises, and how many numbers went up and
    down."""

    cost: float
    step: Array
    decrease: float
    numbers: int

    @property
    def decrement(self) -> float:
        """The distance to the optimum [sigmas]."""
        return float(np.sqrt(self.decrease))

    def told(self, share: float) -> Step:
        """The account of going that share of the step."""
        largest = float(np.abs(self.step).max(initial=0.0))
        return Step(self.cost, self.decrement, largest, 1.0 - share, share > 0.0, 0.0)


class _Team:
    """The coordinator's side of the rounds."""

    def __init__(self, parts: Sequence[Part], raw: Sequence[Table], joined: Values, map_: Submap) -> None:
        self.parts, self.raw, self.map = parts, list(raw), map_
        held = np.concatenate(
            [*(p.kept.keys for p in parts), np.array([p.submap.base for p in parts]), *(t.keys.ravel() for t in raw)]
        )
        self.values = joined.only(np.unique(held))
        self.fixed = np.array([map_.base]) if map_.base >= 0 else np.zeros(0, np.int64)
        self.system: System | None = None
        self.factor: Factor | None = None

    def run(
        self, component: Component, gap: float, max_rounds: int, progress: Callable[[Step], None] | None
    ) -> Component:
        """Rounds until the gap is closed, or until rounding is all that is left of it."""
        for part, values in zip(self.parts, self._local(self.values), strict=True):
            part.reduce()
            part.values = part.follow(values)
        history: list[Step] = []
        bend, status, sent, last = Bend(SLOW), Status.MAX_ITERATIONS, 0, np.inf
        for _ in range(max_rounds):
            ahead = self._round(bend)
            sent += 8 * ahead.numbers
            if ahead.decrement > FALLS * last and ahead.decrease <= self._unseen(ahead.cost):
                status = Status.FLAT
                break
            bend.see(ahead.decrement)
            last = ahead.decrement
            share = self._descend(ahead)
            history.append(ahead.told(share))
            if progress is not None:
                progress(history[-1])
            if not share:
                status = Status.STUCK
                break
            if ahead.decrease <= gap * ahead.cost:
                status = Status.CONVERGED  # and the last step, already known, is taken
                break
        return self._finish(component, status, history, sent)

    def _unseen(self, cost: float) -> float:
        """The decrease of F that its rounding hides: a share of F, or where F is next to nothing that of residuals."""
        residual = max(part.system.rounding(part.values) for part in self.parts)
        return max(UNSEEN * cost, 10.0 * residual * float(np.sqrt(cost + 1.0)))

    def _descend(self, ahead: "_Ahead") -> float:
        """Go the largest share of the step (1, 1/2, 1/4, ...) that does not raise F, and say which; 0 for none."""
        share = 1.0
        while share > LEAST_SHARE:
            candidate = self._retract(share * ahead.step)
            moved = [part.follow(values) for part, values in zip(self.parts, self._local(candidate), strict=True)]
            after = self._raw_cost(candidate) + sum(
                part.system.cost(values) for part, values in zip(self.parts, moved, strict=True)
            )
            if np.isfinite(after) and after <= ahead.cost + UNSEEN * max(ahead.cost, 1.0):
                self.values = candidate
                for part, values in zip(self.parts, moved, strict=True):
                    part.values = values
                return share
            share *= 0.5
        return 0.0

    # --- one round ----------------------------------------------------------------------------------------------

    def _local(self, values: Values) -> list[Values]:
        """Every part's separators, seen from its base."""
        return [values.seen_from(values.pose(part.submap.base), part.kept) for part in self.parts]

    def _round(self, bend: Bend) -> "_Ahead":
        """One round: with curvature where there is enough of it for a step that goes down."""
        while True:
            try:
                return self._linearised(bend.curvature)
            except SolveError:
                if not bend.retreat():
                    raise

    def _linearised(self, curvature: Curvature) -> "_Ahead":
        reduced = [part.reduce(curvature) for part in self.parts]
        terms = [
            SubmapTerm(p.submap.base, p.separators, r.information, r.slope)
            for p, r in zip(self.parts, reduced, strict=True)
        ]
        if self.system is None:
            self.system = System(
                self.values.layout, tables=self.raw, submaps=terms, fixed=self.fixed, names=self.map.names
            )
            self.factor = Factor(self.system.free, self.system.pattern, names=self.map.names)
        else:
            for number, term in enumerate(terms):
                self.system.set_submap(number, term)
        assert self.factor is not None
        at = self.system.linearise(self.values, curvature=curvature)
        self.factor.factorise(at.hessian.numbers)
        step = self.factor.solve(at.gradient)
        return _Ahead(
            cost=sum(r.cost for r in reduced) + self._raw_cost(self.values),
            step=step,
            decrease=max(float(at.gradient @ step) + sum(r.interior for r in reduced), 0.0),
            numbers=sum(r.numbers for r in reduced) + sum(len(p.separators.state) for p in self.parts),
        )

    def _retract(self, step: Array) -> Values:
        assert self.system is not None
        return self.system.retract(self.values, step)

    def _raw_cost(self, values: Values) -> float:
        return sum(float(t.loss.cost(np.sum(t.whitened(values) ** 2, -1)).sum()) for t in self.raw)

    # --- the result ---------------------------------------------------------------------------------------------

    def _finish(self, component: Component, status: Status, history: list[Step], sent: int) -> Component:
        """The whole map at the last point, its information, and how exact it is."""
        terms, slopes_cost, chi2 = [], 0.0, 0.0
        values = self.values
        for part in self.parts:
            at = part.system.linearise(part.values)
            local = part.values.only(part.system.free.keys)
            terms.append(SubmapTerm(part.submap.base, local, at.hessian.to_csr(), at.gradient))
            slopes_cost += at.cost
            chi2 += part.system.chi2(part.values)
            interior = local.select(~self.values.layout.contains(local.layout.keys))
            values = values.update(interior.transform(self.values.pose(part.submap.base)))
        system = System(values.layout, tables=self.raw, submaps=terms, fixed=self.fixed, names=self.map.names)
        at = system.linearise(values)
        factor = Factor(system.free, system.pattern, names=self.map.names)
        factor.factorise(at.hessian.numbers)
        shift = factor.solve(at.gradient)
        decrease = max(float(at.gradient @ shift), 0.0)
        raw_chi2 = sum(float(np.sum(t.whitened(values) ** 2)) for t in self.raw)
        cost = slopes_cost + self._raw_cost(values)
        sigmas = _sigmas(shift, system.free.dof_start, factor.marginals())
        before = component.map.values
        moved = _sigmas(
            values.only(before.layout.keys).minus(before), before.layout.dof_start, _in_order(factor, system, before)
        )
        rows = sum(p.system.rows for p in self.parts) + sum(t.dof for t in self.raw)
        solution = Solution(
            values=values,
            cost=cost,
            chi2=chi2 + raw_chi2,
            rows=rows,
            dof=rows - system.free.dof,
            status=status,
            decrement=float(np.sqrt(decrease)),
            history=tuple(history),
            made=lambda: at.hessian,
        )
        members = [part.submap for part in self.parts]
        final = joined_map(members, self.raw, solution, self.fixed, self.map.names)
        final = replace(final, id=self.map.id, cost=solution.cost, chi2=solution.chi2, rows=rows)
        exactness = Exactness(
            relative_cost_gap=decrease / cost if cost > 0.0 else 0.0,
            gradient_norm=float(np.sqrt(decrease)),
            max_shift_sigma=float(sigmas.max(initial=0.0)),
            join_shift_sigma=float(moved.max(initial=0.0)),
            rounds=len(history) + 1,
            bytes=sent,
        )
        return Component(final, solution, component.members, exactness, component.ambiguities)


def _in_order(factor: Factor, system: System, values: Values) -> list[Array]:
    blocks = factor.marginals()
    return [blocks[int(i)] for i in system.free.index(values.layout.keys)]


def _sigmas(shift: Array, starts: IntArray, covariances: Sequence[Array]) -> Array:
    """The length of each variable's shift in its own standard deviations."""
    out = np.zeros(len(covariances))
    for v, covariance in enumerate(covariances):
        d = shift[starts[v] : starts[v + 1]]
        out[v] = np.sqrt(max(float(d @ np.linalg.solve(covariance, d)), 0.0))
    return out
