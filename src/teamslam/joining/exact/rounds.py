"""Joining that is exact: rounds of one Gauss-Newton step, in which robots send only their reduced information.

Every measurement belongs to one submap and does not care about frames, so the full cost is F(G) = sum_i f_i(h_i(G))
exactly. The paper's join replaces f_i by its quadratic at the local optimum. Here each round renews that quadratic
where the team is:

    robot:        linearises f_i at its point S_i, eliminates its interiors, sends (Lambda, eta, f) over its separators
    coordinator:  e = S^ (-) h(G), one step of sum |e|^2_Lambda + 2 eta'e, and sends the separators' new places back
    robot:        its interiors follow (see `robot`); it answers with its cost there

The first round is the paper's join. From then on this is Gauss-Newton on F by nested dissection, so its fixed point
is grad F = 0: the full nonlinear least squares, though nobody holds all raw data. F is a sum of scalars, so a step
that raises it is known, and halved. What is left is known too: the Newton decrement adds up from the robots' parts.
Where it falls slowly, robots and coordinator take in how residuals bend (solver.newton), and the rounds are Newton's.
Rounding of F hides the last of them; they go on while the decrement falls.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.sparse as sp

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.joining.build.build import build_choices
from teamslam.joining.exact.alone import excess_alone, excess_together
from teamslam.joining.exact.basins import lowest
from teamslam.joining.exact.gap import Gap, frame_of, gap_at, point_of, raw_cost
from teamslam.joining.exact.robot import Part, Reduced, parts_of
from teamslam.joining.join.double_counting import refuse_double_counting
from teamslam.joining.join.join import Component, Joined, in_order, join
from teamslam.joining.join.optimum import in_the_way, joined_map, less
from teamslam.model import WORLD, Dataset, Submap, Table, Values
from teamslam.solver import Factor, Options, Solution, Status, Step, SubmapTerm, System
from teamslam.solver.newton import Bend, Curvature
from teamslam.solver.optimise import DEFAULTS

UNSEEN = 1e-12  # of F: what its rounding hides
FALLS = 0.9  # the decrement that falls less than to this, where F shows nothing any more, is rounding itself
LEAST_SHARE = 1e-4  # of a step
SLOW = 0.25  # as in Bend; a round costs messages, curvature costs none


def exact_join(
    pieces: Sequence[Dataset],
    *,
    choices: Sequence[Sequence[Submap]] | None = None,
    near: Joined | None = None,
    gap: float = 1e-20,
    max_rounds: int = 300,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Joined:
    """The join of the submaps of all pieces, in rounds until it is the full least squares.

    `choices`: of each piece the submaps to start from, as `build_choices` gives them; by default they are built here.
    `near`: as in `join`. Stops when the decrease of F still to be had is below `gap` of F, or rounding is all that is
    left of it. Every component carries its `exactness`; one that did not get there within `max_rounds` says so in its
    status. Law: the estimate is that of `full` on the same data. Raises as `build` and `join` do.
    """
    if choices is None:
        choices = [build_choices(piece, options=options) for piece in pieces]
    raw_of = {found[0].id: piece for piece, found in zip(pieces, choices, strict=True)}
    refuse_double_counting(in_order(found[0] for found in choices))
    rough = replace(options, decrement=max(options.decrement, 1e-3))

    def solve(submaps: Sequence[Submap]) -> Joined:
        built = {submap.id: (raw_of[submap.id], submap) for submap in submaps}
        first = join(submaps, near=near, options=rough)
        components = (
            _rounds(c, [built[name] for name in c.members], gap, max_rounds, progress) for c in first.components
        )
        return Joined(tuple(components), first.reasons)

    tables = [table for piece in pieces for table in piece.tables]
    return lowest(choices, solve, partial(excess_alone, tables), partial(excess_together, tables))


def _rounds(
    component: Component,
    members: Sequence[tuple[Dataset, Submap]],
    gap: float,
    max_rounds: int,
    progress: Callable[[Step], None] | None,
) -> Component:
    joined = component.map
    held = np.concatenate([submap.values.layout.keys for _, submap in members])
    while True:
        parts, raw = parts_of(members, point_of(joined).layout, world=joined.base == WORLD)
        try:
            return _Team(parts, raw, joined).run(component, gap, max_rounds, progress)
        except SolveError as error:
            left = less(joined.values, in_the_way(joined.values, error, held, raw))
            joined = replace(joined, values=left, information=sp.csr_array(joined.information_of(left.layout.keys)))


@dataclass(frozen=True, eq=False)
class _Ahead:
    """What a round found: F here, the step, and the decrease of F that it promises."""

    cost: float
    step: Array
    decrease: float

    @property
    def decrement(self) -> float:
        """The distance to the optimum [sigmas]."""
        return float(np.sqrt(self.decrease))

    def told(self, share: float) -> Step:
        """The account of going that share of the step."""
        largest = float(np.abs(self.step).max(initial=0.0))
        return Step(self.cost, self.decrement, largest, 1.0 - share, share > 0.0, 0.0)


class _Team:
    """The coordinator's side of the rounds. It counts them, and every number that goes up or down."""

    def __init__(self, parts: Sequence[Part], raw: Sequence[Table], joined: Submap) -> None:
        self.parts, self.raw, self.map = parts, list(raw), joined
        held = np.concatenate(
            [*(p.kept.keys for p in parts), np.array([p.submap.base for p in parts]), *(t.keys.ravel() for t in raw)]
        )
        self.values = point_of(joined).only(np.unique(held))
        self.system: System | None = None
        self.factor: Factor | None = None
        self.rounds, self.numbers = 0, 0

    def run(
        self, component: Component, gap: float, max_rounds: int, progress: Callable[[Step], None] | None
    ) -> Component:
        """The paper's join, which is where the map is, and rounds until the gap is closed, or until rounding is all
        that is left of it."""
        self._reduced("none")
        self._place(self._moved(self.values, 1.0))
        history: list[Step] = []
        bend, status, last = Bend(SLOW), Status.MAX_ITERATIONS, np.inf
        for _ in range(max_rounds):
            ahead = self._round(bend)
            if ahead.decrement > FALLS * last and ahead.decrease <= self._unseen(ahead.cost):
                status = Status.FLAT
                break
            bend.see(ahead.decrement)
            last = ahead.decrement
            share = self._descend(ahead)
            history.append(ahead.told(share))
            if progress is not None:
                progress(history[-1])
            if not share and bend.retreat():
                last = np.inf
                continue  # curvature that leads nowhere here: the next round goes without
            if not share:
                status = Status.FLAT if ahead.decrease <= self._unseen(ahead.cost) else Status.STUCK
                break
            if ahead.decrease <= gap * ahead.cost:
                status = Status.CONVERGED  # and the last step, already known, is taken
                break
        return self._finish(component, status, history)

    def _unseen(self, cost: float) -> float:
        """The decrease of F that its rounding hides: a share of F, or where F is next to nothing that of residuals."""
        assert self.system is not None
        of_parts = [part.system.rounding(part.values) for part in self.parts]
        residual = max([*of_parts, self.system.rounding(self.values)])  # the world's origin may be far away
        return max(UNSEEN * max(cost, 1.0), 10.0 * residual * float(np.sqrt(cost + 1.0)))

    def _descend(self, ahead: "_Ahead") -> float:
        """Go the largest share of the step (1, 1/2, 1/4, ...) that does not raise F, and say which; 0 for none."""
        share = 1.0
        while share > LEAST_SHARE:
            candidate = self._retract(share * ahead.step)
            moved = self._moved(candidate, share)
            after = raw_cost(self.raw, candidate) + self._costs(moved)
            if np.isfinite(after) and after <= ahead.cost + self._unseen(ahead.cost):
                self.values = candidate
                self._place(moved)
                return share
            share *= 0.5
        return 0.0

    def _place(self, moved: Sequence[Values]) -> None:
        for part, values in zip(self.parts, moved, strict=True):
            part.values = values

    # --- messages -----------------------------------------------------------------------------------------------

    def _reduced(self, curvature: Curvature) -> list[Reduced]:
        """A round: every robot linearises where it is, and sends what is left without its interiors."""
        self.rounds += 1
        sent = []
        for part in self.parts:
            sent.append(part.reduce(curvature))
            self.numbers += sent[-1].numbers
        return sent

    def _moved(self, values: Values, share: float) -> list[Values]:
        """Where the robots would be with the separators there, by this share of the step, which they are told."""
        self.numbers += sum(part.sending.placing for part in self.parts)
        local = (values.seen_from(values.pose(part.submap.base), part.kept) for part in self.parts)
        return [part.follow(separators, share) for part, separators in zip(self.parts, local, strict=True)]

    def _costs(self, moved: Sequence[Values]) -> float:
        """What the robots' measurements would cost there, one number from each."""
        self.numbers += len(self.parts)
        return sum(part.system.cost(values) for part, values in zip(self.parts, moved, strict=True))

    # --- one round ----------------------------------------------------------------------------------------------

    def _round(self, bend: Bend) -> "_Ahead":
        """One round: with curvature where there is enough of it for a step that goes down."""
        while True:
            try:
                return self._linearised(bend.curvature)
            except SolveError:
                if not bend.retreat():
                    raise

    def _linearised(self, curvature: Curvature) -> "_Ahead":
        reduced = self._reduced(curvature)
        terms = [
            SubmapTerm(p.submap.base, p.separators, r.information, r.slope)
            for p, r in zip(self.parts, reduced, strict=True)
        ]
        if self.system is None:
            self.system = System(
                self.values.layout, tables=self.raw, submaps=terms, fixed=frame_of(self.map), names=self.map.names
            )
            self.factor = self.system.factor(self.values)
        else:
            for number, term in enumerate(terms):
                self.system.set_submap(number, term)
        assert self.factor is not None
        at = self.system.linearise(self.values, curvature=curvature)
        self.factor.factorise(at.hessian.numbers)
        step = self.factor.solve(at.gradient)
        return _Ahead(
            cost=sum(r.cost for r in reduced) + raw_cost(self.raw, self.values),
            step=step,
            decrease=max(float(at.gradient @ step) + sum(r.interior for r in reduced), 0.0),
        )

    def _retract(self, step: Array) -> Values:
        assert self.system is not None
        return self.system.retract(self.values, step)

    # --- the result ---------------------------------------------------------------------------------------------

    def _finish(self, component: Component, status: Status, history: list[Step]) -> Component:
        """The whole map at the last point, its information, and how exact it is."""
        values = self._everything()
        tables = [*(table for part in self.parts for table in part.system.tables), *self.raw]
        gap = gap_at(values, tables, self.map)
        solution = self._solution(values, gap, status, history)
        members, fixed = [part.submap for part in self.parts], frame_of(self.map)
        final = joined_map(members, self.raw, solution, fixed, self.map.names, self.map.base_dim)
        final = replace(final, id=self.map.id, cost=solution.cost, chi2=solution.chi2, rows=solution.rows)
        before = self.map.values
        exactness = gap.exactness(
            join_shift_sigma=gap.farthest(values.only(before.layout.keys).minus(before), before.layout),
            rounds=self.rounds,
            bytes=8 * self.numbers if len(self.parts) > 1 else 0,
        )
        return Component(final, solution, component.members, exactness, component.dearer)

    def _everything(self) -> Values:
        """The separators' places, and all robots' interiors seen from there."""
        values = self.values
        for part in self.parts:
            inside = ~self.values.layout.contains(part.system.free.keys)
            interior = part.values.only(part.system.free.keys[inside])
            values = values.update(interior.transform(self.values.pose(part.submap.base)))
        return values

    def _solution(self, values: Values, gap: Gap, status: Status, history: Sequence[Step]) -> Solution:
        rows = sum(p.system.rows for p in self.parts) + sum(t.dof for t in self.raw)
        of_parts = sum(part.system.chi2(part.values) for part in self.parts)
        return Solution(
            values=values,
            cost=gap.cost,
            chi2=of_parts + sum(float(np.sum(t.whitened(values) ** 2)) for t in self.raw),
            rows=rows,
            dof=rows - gap.free.dof,
            status=status,
            decrement=float(np.sqrt(gap.decrease)),
            history=tuple(history),
            made=lambda: gap.hessian,
        )
