"""One loop for every least-squares problem; Gauss-Newton, Levenberg-Marquardt and dogleg are step rules (`rules`).

    repeat   linearise -> ask the rule for a step d -> try x (+) d -> tell the rule how well the model predicted

Near the optimum H hardly changes any more, so there steps go on with the factor at hand (the chord method) while each
of them shrinks the gradient tenfold; between submaps, whose gradient costs a small part of a factor, as long as they
come nearer at all, and what they see of the gradient puts the factor right (`secants`).

It stops on the Newton decrement sqrt(g' H^-1 g): the distance to the optimum of the model in sigmas, so that no
variable, and no combination of them, is farther from the optimum than that many of its own standard deviations. That is
a test on the gradient, in the only norm that knows the units; the cost alone never counts as convergence. Where the
rounding of the cost hides progress, full steps go on while the decrement falls; what it takes for them to converge fast
is in `newton`.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from teamslam.errors import InputError, SolveError
from teamslam.model import Values
from teamslam.solver.faults import Open, fault_at, fault_of_step
from teamslam.solver.linear import Factor, Matrix
from teamslam.solver.newton import SLOW, SLOW_JOIN, Bend, Curvature
from teamslam.solver.rules import RULES, Proposal, dot, full_step
from teamslam.solver.saddle import way_down
from teamslam.solver.secants import Secants
from teamslam.solver.solution import Solution, Status, Step
from teamslam.solver.system import Linearised, System


@dataclass(frozen=True)
class Options:
    """How to solve.

    `rule`: a row of RULES. It has converged when a step leaves the optimum at most `decrement` [sigmas] away, or the
    decrease still to be had below `cost_share` of the cost. `elsewhere`: whether what ends short of an optimum, or in
    one that makes no sense, goes on from other starts; a what-if beside an optimum that is known has no use for them.
    Raises InputError for values that make no sense.
    """

    rule: str = "levenberg_marquardt"
    max_iterations: int = 1000
    decrement: float = 1e-6
    cost_share: float = 1e-16
    elsewhere: bool = True

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise InputError(f"unknown step rule '{self.rule}'; choose one of {', '.join(RULES)}")
        if self.max_iterations < 1:
            raise InputError(f"max_iterations is at least 1, found {self.max_iterations}")
        if not (self.decrement > 0.0 and self.cost_share >= 0.0):
            raise InputError("decrement must be above zero and cost_share not below it")


DEFAULTS = Options()
SETTLED = 0.3  # [sigmas of an unknown, on average]: a step this small leaves H nearly as it is
CHORD = 0.1  # how much shorter than the step before one with its factor must be
CAUTION = 4.0  # how much larger the share that a step leaves may be than that of the step before
FORETOLD = 0.25  # the gain from which on a decrease was seen as predicted
STIFF = 1e-4  # of what the same step would cost were each unknown to go it alone: less is along what is weak
POOR = 0.1  # the gain below which half of a step by secants is tried, and of that half
HALVES = 3
CORRECTIONS = 6  # steps that bring one back to what stiff measurements hold
NEGLIGIBLE = 1e-3  # [sigmas]: where no step goes down and the optimum is so near, rounding is in the way
ROUNDING = 1e-10  # of the cost: a full step that promises less, and gains nothing, is at the end of what can be seen


def optimise(
    system: System,
    start: Values,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
    factor: Factor | None = None,
) -> Solution:
    """The values that minimise the system's cost, from `start`. `progress` hears of every step once.

    The information returned is H = J'W'WJ at the estimate, not damped; where it has no factor at a search's end, that
    is short of an optimum, and its decrement inf. Raises SolveError, naming the variable, where no step can be had
    because nothing measures it, and where it rests at an optimum by the cost's curvature alone.
    """
    search = _Search(system, start, options, progress)
    if system.free.dof == 0:
        search.status, search.decrement = Status.EMPTY, 0.0
        return search.solution()
    search.factor = factor or system.factor(start)
    with np.errstate(over="ignore", invalid="ignore"):
        while len(search.history) < options.max_iterations and search.status is Status.MAX_ITERATIONS:
            trial = search.propose()
            if trial is None:
                continue
            if trial.is_last:
                search.arrive(trial)
            else:
                search.go_on(trial)
        return search.solution()


@dataclass(frozen=True, eq=False)
class _Trial:
    """A step, how far it goes [sigmas] (to the optimum of the model where it is a full one), where it leads, how far
    the optimum is expected to be then, and whether that is near enough."""

    step: Proposal
    decrement: float
    values: Values
    ahead: float
    is_last: bool


class _Search:
    """Where a run is, and what its steps have told so far."""

    factor: Factor
    values: Values
    at: Linearised
    cost: float
    made: Callable[[], Matrix]

    def __init__(
        self, system: System, start: Values, options: Options, progress: Callable[[Step], None] | None
    ) -> None:
        self.began = time.perf_counter()
        self.system, self.options, self.rule, self.progress = system, options, RULES[options.rule](), progress
        self.start = start
        at = self._look(start, "none")
        if at is None:
            raise fault_at(system, start)
        self._stand(start, at)
        self.history: list[Step] = []
        self.status, self.decrement = Status.MAX_ITERATIONS, math.inf
        self.bend = Bend(SLOW_JOIN if system.is_join else SLOW)
        self.factored: Curvature = "none"  # what the factor at hand holds
        self.settled = False  # whether the factor at hand still serves
        self.secants = Secants() if system.is_join else None
        self.before, self.best = math.nan, math.inf  # decrements: of the step before, and the least that rounding hid
        self.refused_at: Linearised | None = None  # where a full step was refused

    def propose(self) -> _Trial | None:
        """The next step to try; None where there is none, and something else was done about it."""
        try:
            step = self._chord_step() or self._fresh_step()
        except SolveError as problem:
            if not self.bend.retreat():
                raise self._named(problem) from None
            self.settled, self.at = False, self._looked(self.values)
            return None
        if not math.isfinite(step.predicted) and not np.isfinite(step.delta).all():
            raise fault_of_step(self.system, step.delta)
        if not step.is_full and step.predicted <= self._visible():
            self._out_of_sight()
            return None
        decrement = math.sqrt(max(step.predicted, 0.0))
        self.bend.see(decrement, step.is_full)
        ahead = self._ahead(decrement) if step.is_full else math.inf
        near = ahead <= self.options.decrement or ahead**2 <= self.options.cost_share * self.cost
        return _Trial(step, decrement, self.system.retract(self.values, step.delta), ahead, near)

    def arrive(self, trial: _Trial) -> None:
        """Take the last step, which is far below what matters, unless rounding makes it worse than it is worth."""
        cost = self.system.cost(trial.values) if np.isfinite(trial.values.state).all() else math.inf
        taken = cost <= self.cost or cost - self.cost <= 1e-9 * self.cost + self._visible()
        self._note(trial, taken)
        values, cost = (trial.values, cost) if taken else (self.values, self.cost)
        if self.system.forgives and self.factored == "none" and self._left_saddle(values):
            return
        if taken:
            self.values, self.cost, self.made = values, cost, partial(_information, self.system, values)
        if self.factored != "none":
            self._refuse_open()
        self.status, self.decrement = Status.CONVERGED, trial.ahead

    def go_on(self, trial: _Trial) -> None:
        """Take the step if the rule wants it; the status tells where nothing more can be gained."""
        settling = trial.step.is_full and trial.decrement < SETTLED * math.sqrt(len(trial.step.delta))
        after = self._look(trial.values, self.bend.curvature, lazy=settling)
        gain = self._gain(trial, after)
        if gain is None:
            self._stop()
            return
        if self.secants and self.settled:
            if gain < POOR:
                trial, after, gain = self._shortened(trial, after)
            if gain < POOR:
                self.settled = False
                self._note(trial, False)
                return
        elif after is not None and gain < (POOR if settling and self.secants else self.rule.corrects_below):
            trial, after, gain = self._corrected(trial, after, gain)
            settling = False
        try:
            accepted = self.rule.hear(gain) and after is not None
        except StopIteration:
            self._stop()
            return
        self._note(trial, accepted)
        self.settled = accepted and settling
        if not accepted and trial.step.is_full:
            self.refused_at = self.at
        if accepted:
            assert after is not None
            if self.secants:
                self.secants.see(trial.decrement, trial.step.delta, self.at.gradient, after.gradient)
            self._stand(trial.values, after)
            self.before = trial.decrement if trial.step.is_full else math.nan

    def solution(self) -> Solution:
        """The estimate as it stands."""
        system = self.system
        if self.status is Status.MAX_ITERATIONS:
            self.decrement = self._distance_so_far()
        robust = any(table.loss.name != "squared" for table in system.tables)
        return Solution(
            values=self.values,
            cost=self.cost,
            chi2=system.chi2(self.values) if robust else self.cost,
            rows=system.rows,
            dof=system.rows - system.free.dof,
            status=self.status,
            decrement=self.decrement,
            history=tuple(self.history),
            made=self.made,
        )

    # --- points ---------------------------------------------------------------------------------------------------

    def _look(self, values: Values, curvature: Curvature, lazy: bool = False) -> Linearised | None:
        """The problem at some values; None where they, or what they cost, are beyond all numbers. Raises SolveError
        where they cost something and yet have no finite derivative, naming the measurement."""
        if not np.isfinite(values.state).all():
            return None
        at = self.system.linearise(values, curvature=curvature, lazy=lazy)
        if not math.isfinite(at.cost):
            return None
        if not np.isfinite(at.gradient).all():
            raise fault_at(self.system, values)
        return at

    def _looked(self, values: Values) -> Linearised:
        """The problem at values that were looked at before."""
        return self.system.linearise(values, curvature=self.bend.curvature)

    def _stand(self, values: Values, at: Linearised) -> None:
        """Be at these values. Their H without curvature is made when it is asked for."""
        self.values, self.at, self.cost = values, at, at.cost
        self.made = lambda: at.information

    # --- steps ----------------------------------------------------------------------------------------------------

    def _fresh_step(self) -> Proposal:
        """The step of the rule, by a factor made anew."""
        self.factored, self.settled = self.at.curvature, False
        if self.secants:
            self.secants.begin()
        return self.rule.propose(self.factor, self.at, self.bend.insists)

    def _chord_step(self) -> Proposal | None:
        """The full step by the factor of the step before, where that still serves."""
        if not self.settled:
            return None
        if self.secants:
            return self.secants.step(self.factor, self.at.gradient)
        step = full_step(self.factor, self.at)
        return step if step.predicted < (CHORD * self.history[-1].decrement) ** 2 else None

    def _shortened(self, trial: _Trial, after: Linearised | None) -> tuple[_Trial, Linearised | None, float]:
        """Half of a step by secants, which may be too long while these are few, or half of that."""
        gain, whole, length = -math.inf, trial.step, 1.0
        for _ in range(HALVES):
            length *= 0.5
            delta = length * whole.delta
            trial = replace(trial, step=replace(whole, delta=delta), values=self.system.retract(self.values, delta))
            after = self._look(trial.values, self.bend.curvature, lazy=True)
            if after is not None:
                gain = (self.cost - after.cost) / (length * (2.0 - length) * whole.predicted)
            if gain >= POOR:
                break
        return trial, after, gain

    def _corrected(self, trial: _Trial, after: Linearised, gain: float) -> tuple[_Trial, Linearised, float]:
        """A step along what is weak goes up because it leaves, on a curve, what stiff measurements hold: Newton's steps
        from there bring it back to them (Nocedal & Wright, sec. 18.3: second-order corrections), towards the least of
        the cost and of what the damping D adds to it, |x - x0|^2_D. As it was, unless the step is weak, each correction
        is half as long as what went before, and the cost ends lower."""
        values, at, gone, damping = trial.values, after, trial.step.delta, trial.step.damping
        length = float(np.abs(gone).max())
        if trial.step.predicted > STIFF * dot(self.at.scale * gone, gone):
            return trial, after, gain
        for _ in range(CORRECTIONS):
            try:
                self.factor.factorise(at.hessian.numbers, damping)
            except SolveError:
                break
            correction = self.factor.solve(at.gradient if damping is None else at.gradient - damping * gone)
            shorter = float(np.abs(correction).max())
            if not shorter < 0.5 * length:
                break
            length, values, gone = shorter, self.system.retract(values, correction), gone + correction
            looked = self._look(values, self.bend.curvature)
            if looked is None:
                break
            at = looked
            if (better := (self.cost - at.cost) / trial.step.predicted) > gain:
                trial, after, gain = replace(trial, values=values), at, better
            if gain >= self.rule.corrects_below:
                break
        return trial, after, gain

    def _ahead(self, decrement: float) -> float:
        """How far from the optimum a step leaves us, by how much shorter it is than the one before (Deuflhard, "Newton
        Methods for Nonlinear Problems", 2011, ch. 2): each leaves a share of the distance that hardly grows any
        more."""
        return decrement * min(1.0, CAUTION * decrement / self.before) if self.before > 0.0 else decrement

    # --- what rounding hides ----------------------------------------------------------------------------------------

    @cached_property
    def _rounding(self) -> float:
        """Of one residual, with room [sigmas]."""
        return 10.0 * self.system.rounding(self.start)

    def _visible(self) -> float:
        """The least difference of costs that rounding does not hide."""
        return self._rounding * math.sqrt(self.cost + 1.0)

    def _gain(self, trial: _Trial, after: Linearised | None) -> float | None:
        """The actual decrease over the predicted one; None where a full step is hidden by rounding and the decrement no
        longer falls, while a hidden step that is shorter than those before is trusted."""
        if after is None:
            return -math.inf
        actual, predicted = self.cost - after.cost, trial.step.predicted
        gain = actual / predicted if predicted > 0.0 else -math.inf
        if gain > FORETOLD and predicted > ROUNDING * self.cost:
            return gain
        # A sum of large terms of both signs rounds earlier than one of squares does.
        hidden = predicted <= self._visible() or (gain <= 0.0 and predicted <= ROUNDING * self.cost)
        if not (trial.step.is_full and hidden):
            return gain
        if not trial.decrement < 0.5 * self.best:
            return None
        self.best = trial.decrement
        return 1.0

    def _out_of_sight(self) -> None:
        """A damped step is lost in rounding: damping has outlived its reason, or hides that the cost bends down, or
        this is the end."""
        self.settled = False
        if self.at.curvature != "none" and self._left_saddle(self.values):
            return
        if self.refused_at is self.at:
            self._stop()
        else:
            self.refused_at = self.at
            self.rule.reset()

    def _left_saddle(self, values: Values) -> bool:
        """Whether the cost bends down at `values`, where its gradient is next to nothing, and a way down was taken."""
        curvature: Curvature = "losses" if self.bend.curvature == "none" else self.bend.curvature
        at = self.system.linearise(values, curvature=curvature)
        way = way_down(self.factor, at)
        self.factored = curvature
        if way is None:
            return False
        length = 1.0
        while (predicted := way.decrease(length)) > self._visible():
            moved = self.system.retract(values, length * way.direction)
            after = self._look(moved, curvature)
            if after is not None and at.cost - after.cost > 0.25 * predicted:
                self.bend.follow(curvature)
                self._stand(moved, after)
                self.rule.reset()
                self.settled, self.before, self.best = False, math.nan, math.inf
                return True
            length *= 0.5
        return False

    # --- the end ----------------------------------------------------------------------------------------------------

    def _stop(self) -> None:
        """No step is to be had any more: at an optimum to rounding, or short of it."""
        self.decrement = self._distance()
        small = self.decrement**2 <= max(self._visible(), ROUNDING * self.cost, NEGLIGIBLE**2)
        self.status = Status.FLAT if small else Status.STUCK

    def _distance(self) -> float:
        """The Newton decrement where the search is [sigmas], by the information; inf where that has no factor, and
        nobody can tell."""
        try:
            self.factor.factorise(self.at.information.numbers)
        except SolveError:
            return math.inf
        return math.sqrt(max(dot(self.at.gradient, self.factor.solve(self.at.gradient)), 0.0))

    def _refuse_open(self) -> None:
        """Raise SolveError where the curvature at an optimum holds what the information leaves open."""
        information = self.made()
        try:
            self.factor.factorise(information.numbers)
        except SolveError as problem:
            raise self._named(problem) from None
        self.made = lambda: information

    def _distance_so_far(self) -> float:
        """The same on the way, where a variable may be open as yet: as far as what is held tells, if it does."""
        damping = 0.0
        while True:
            try:
                self.factor.factorise(self.at.information.numbers, damping * self.at.scale)
            except SolveError:
                if damping > 1.0:
                    return math.inf
                damping = max(ROUNDING, 10.0 * damping)
            else:
                return math.sqrt(max(dot(self.at.gradient, self.factor.solve(self.at.gradient)), 0.0))

    def _named(self, problem: SolveError) -> SolveError:
        """Why H has no factor: numbers that are not finite, or as the factor said."""
        finite = np.isfinite(self.at.hessian.numbers).all()
        return Open(problem, self.values) if finite else fault_at(self.system, self.values)

    def _note(self, trial: _Trial, accepted: bool) -> None:
        largest, elapsed = float(np.abs(trial.step.delta).max()), time.perf_counter() - self.began
        self.history.append(Step(self.cost, trial.decrement, largest, self.rule.damping, accepted, elapsed))
        if self.progress is not None:
            self.progress(self.history[-1])


def _information(system: System, values: Values) -> Matrix:
    """H at some values; no method, since a solution that keeps a search would keep its factor's memory too."""
    return system.linearise(values).hessian
