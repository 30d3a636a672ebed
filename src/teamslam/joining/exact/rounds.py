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

Steps are shortened as a whole, never damped, so far from the optimum in a narrow valley none may go down. Robots that
hold their rows for themselves say so and end there; one process, which holds all, goes on by full least squares from
there and checks by rounds what that finds. Bytes that are told are those of rounds.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining.build.build import build_choices
from teamslam.joining.exact.alone import excess_alone, excess_together
from teamslam.joining.exact.basins import lowest
from teamslam.joining.exact.coordinator import UNSEEN, Coordinator, Ended, Parts
from teamslam.joining.exact.gap import Gap, frame_of, gap_at, point_of
from teamslam.joining.exact.instead import exact_or_joined
from teamslam.joining.exact.robot import Part, parts_of
from teamslam.joining.join.double_counting import refuse_double_counting
from teamslam.joining.join.join import Component, Exactness, Joined, in_order, join
from teamslam.joining.join.optimum import in_the_way, joined_map, less
from teamslam.joining.start.adrift import adrift
from teamslam.model import WORLD, Dataset, Submap, Table, Values
from teamslam.model.sparse import sp
from teamslam.solver import Options, Solution, Status, Step, System, reach
from teamslam.solver.optimise import DEFAULTS


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
    status, and so does one from which rounds lead to no optimum: it is that of `join`, and a remark says why. Law: the
    estimate is that of `full` on the same data. Raises as `build` and `join` do.
    """
    if choices is None:
        choices = [build_choices(piece, options=options) for piece in pieces]
    raw_of = {found[0].id: piece for piece, found in zip(pieces, choices, strict=True)}
    refuse_double_counting(in_order(found[0] for found in choices))
    rough = replace(options, decrement=max(options.decrement, 1e-3))

    def solve(submaps: Sequence[Submap]) -> Joined:
        built = {submap.id: (raw_of[submap.id], submap) for submap in submaps}
        first = join(submaps, near=near, options=rough)
        return exact_or_joined(
            first,
            lambda c: _rounds(c, [built[name] for name in c.members], gap, max_rounds, options, progress),
            lambda c: join([built[name][1] for name in c.members], near=Joined((c,)), options=options),
            tables,
        )

    tables = [table for piece in pieces for table in piece.tables]
    return lowest(choices, solve, partial(excess_alone, tables), partial(excess_together, tables))


def _rounds(
    component: Component,
    members: Sequence[tuple[Dataset, Submap]],
    gap: float,
    max_rounds: int,
    options: Options,
    progress: Callable[[Step], None] | None,
) -> Component:
    joined = component.map
    if not joined.dof:
        return replace(component, exactness=Exactness(0.0, 0.0, 0.0, 0.0, 0, 0))
    held = np.concatenate([submap.values.layout.keys for _, submap in members])
    while True:
        parts, raw = parts_of(members, point_of(joined).layout, world=joined.base == WORLD)
        try:
            found = _Team(parts, raw, joined).run(component, gap, max_rounds, options, progress)
            gone = np.setdiff1d(adrift(found.map.all_values, raw, settled=found.converged), held)
            if not len(gone):
                return found
        except SolveError as error:
            gone = in_the_way(joined.values, error, held, raw)
        left = less(joined.values, gone)
        joined = replace(joined, values=left, information=sp.csr_array(joined.information_of(left.layout.keys)))


class _Team:
    """The rounds in one process: a coordinator, and all robots' parts."""

    def __init__(self, parts: Sequence[Part], raw: Sequence[Table], joined: Submap) -> None:
        self.parts, self.raw, self.map = parts, list(raw), joined
        self.coordinator = Coordinator(parts, raw, joined)

    def run(
        self,
        component: Component,
        gap: float,
        max_rounds: int,
        options: Options,
        progress: Callable[[Step], None] | None,
    ) -> Component:
        """Rounds until they end, and the whole map. Where full least squares led to an optimum and rounds from there to
        nothing lower, it is one: in a valley so narrow that it is known by its curvature alone, rounds cannot tell."""
        ended = self._course(gap, max_rounds, progress)
        if ended.status is Status.STUCK:
            found = self._go_on_together(options)
            ended = self._course(gap, max_rounds, progress)
            if ended.status is Status.STUCK and ended.history[-1].cost >= found.cost * (1.0 - UNSEEN):
                ended = replace(ended, status=found.status)
        return self._finish(component, ended)

    def _course(self, gap: float, max_rounds: int, progress: Callable[[Step], None] | None) -> Ended:
        """Rounds from where the team is, asked and answered until they end."""
        course, robots, answer = self.coordinator.course(gap, max_rounds, progress), Parts(self.parts), None
        while True:
            try:
                ask = course.send(answer) if not isinstance(answer, SolveError) else course.throw(answer)
            except StopIteration as done:
                ended: Ended = done.value
                return ended
            try:
                answer = robots.answer(ask)
            except SolveError as error:
                answer = error

    def _go_on_together(self, options: Options) -> Solution:
        """Go where full least squares of all rows leads from here."""
        values, tables = self._everything(), self._tables()
        system = System(values.layout, tables=tables, fixed=frame_of(self.map), names=self.map.names)
        solution = reach(system, values, options)
        found = solution.values
        self.coordinator.values = found.only(self.coordinator.values.layout.keys)
        for part in self.parts:
            part.values = found.seen_from(found.pose(part.submap.base), part.values.layout)
        return solution

    # --- the result ---------------------------------------------------------------------------------------------

    def _finish(self, component: Component, ended: Ended) -> Component:
        """The whole map at the last point, its information, and how exact it is."""
        values = self._everything()
        gap = gap_at(values, self._tables(), self.map)
        solution = self._solution(values, gap, ended.status, ended.history)
        members, fixed = [part.submap for part in self.parts], frame_of(self.map)
        final = joined_map(members, self.raw, solution, fixed, self.map.names, self.map.base_dim)
        final = replace(final, id=self.map.id, cost=solution.cost, chi2=solution.chi2, rows=solution.rows)
        before = self.map.values
        exactness = gap.exactness(
            join_shift_sigma=gap.farthest(values.only(before.layout.keys).minus(before), before.layout),
            rounds=ended.rounds,
            bytes=8 * ended.numbers if len(self.parts) > 1 else 0,
        )
        return Component(final, solution, component.members, exactness, component.dearer)

    def _tables(self) -> list[Table]:
        """All rows: those of the parts, and those that travel with the submaps."""
        return [*(table for part in self.parts for table in part.system.tables), *self.raw]

    def _everything(self) -> Values:
        """The separators' places, and all robots' interiors seen from there."""
        values = common = self.coordinator.values
        for part in self.parts:
            inside = ~common.layout.contains(part.system.free.keys)
            interior = part.values.only(part.system.free.keys[inside])
            values = values.update(interior.transform(common.pose(part.submap.base)))
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
