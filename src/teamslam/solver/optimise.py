"""One loop for every least-squares problem; Gauss-Newton, Levenberg-Marquardt and dogleg are step rules (`rules`).

    repeat   linearise -> ask the rule for a step d -> try x (+) d -> tell the rule how well the model predicted

Near the optimum H hardly changes any more, so there steps go on with the factor at hand (the chord method) while each
of them shrinks the gradient tenfold.

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
from functools import cached_property

import numpy as np

from teamslam.errors import InputError, SolveError
from teamslam.geometry import Array
from teamslam.model import Values
from teamslam.solver.linear import Factor, Matrix
from teamslam.solver.newton import Bend
from teamslam.solver.rules import RULES, dot
from teamslam.solver.solution import Solution, Status, Step
from teamslam.solver.system import Linearised, System


@dataclass(frozen=True)
class Options:
    """How to solve.

    `rule`: a row of RULES. It has converged when a step leaves the optimum at most `decrement` [sigmas] away, or the
    decrease still to be had below `cost_share` of the cost. Raises InputError for values that make no sense.
    """

    rule: str = "levenberg_marquardt"
    max_iterations: int = 300
    decrement: float = 1e-6
    cost_share: float = 1e-16

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
ROUNDING = 1e-10  # of the cost: a full step that promises less, and gains nothing, is at the end of what can be seen


def optimise(
    system: System,
    start: Values,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
    factor: Factor | None = None,
) -> Solution:
    """The values that minimise the system's cost, from `start`. `progress` hears of every step once.

    The information returned is H = J'W'WJ at the estimate, not damped. Raises SolveError where the measurements do not
    determine a variable, naming it.
    """
    search = _Search(system, start, options, progress)
    if system.free.dof == 0:
        search.status = Status.EMPTY
        return search.solution()
    search.factor = factor or system.factor(start)
    while len(search.history) < options.max_iterations and search.status is Status.MAX_ITERATIONS:
        trial = search.propose()
        if trial is None:
            continue
        if trial.is_last:
            search.arrive(trial)
        else:
            search.go_on(trial)
    return search.solution()


def convex_start(system: System, start: Values, options: Options = DEFAULTS) -> Values:
    """A better start where losses forgive far outliers: under those, a start may lie beyond what they still see.

    Huber's loss of the same scale has one basin for each row; it is solved first, roughly. Where no loss forgives,
    `start`.
    """
    convex = system.convex()
    if convex is system:
        return start
    return optimise(convex, start, replace(options, decrement=max(options.decrement, 0.1))).values


@dataclass(frozen=True, eq=False)
class _Trial:
    """A step and where it leads: the decrease that the model predicts, the distance that this means [sigmas] if the
    step is a full one (else nan), and the distance that it is expected to leave."""

    delta: Array
    predicted: float
    values: Values
    decrement: float
    ahead: float
    is_last: bool

    @property
    def is_full(self) -> bool:
        return not math.isnan(self.decrement)


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
        self._stand(start, system.linearise(start))
        if not math.isfinite(self.cost):
            raise SolveError("the cost is not finite at the start values; look for infinite or coincident start values")
        self.history: list[Step] = []
        self.status, self.decrement = Status.MAX_ITERATIONS, math.inf
        self.start = start
        self.bend = Bend()
        self.settled = False  # whether the factor at hand still serves
        self.before, self.best = math.nan, math.inf  # decrements: of the step before, and the least that rounding hid

    def propose(self) -> _Trial | None:
        """The next step to try; None where H was indefinite and is to be made anew without curvature."""
        try:
            delta, predicted, full = self._chord_step() or self.rule.propose(self.factor, self.at)
        except SolveError:
            if not self.bend.retreat():
                raise
            self.settled, self.at = False, self.system.linearise(self.values)
            return None
        distance = math.sqrt(max(predicted, 0.0))
        self.bend.see(distance)
        self.decrement = distance if full else math.nan
        ahead = self._ahead(self.decrement)
        near = ahead <= self.options.decrement or ahead**2 <= self.options.cost_share * self.cost
        values = self.system.retract(self.values, delta)
        return _Trial(delta, predicted, values, self.decrement, ahead, full and near)

    def arrive(self, trial: _Trial) -> None:
        """Take the last step, which is far below what matters, unless rounding makes it worse than it is worth."""
        cost = self.system.cost(trial.values)
        taken = cost <= self.cost or cost - self.cost <= 1e-9 * self.cost + self._visible()
        self._note(trial, taken)
        if taken:
            system, values = self.system, trial.values
            self.values, self.cost, self.made = values, cost, lambda: system.linearise(values).hessian
        self.status, self.decrement = Status.CONVERGED, trial.ahead

    def go_on(self, trial: _Trial) -> None:
        """Take the step if the rule wants it; the status tells where nothing more can be gained."""
        settling = trial.is_full and trial.decrement < SETTLED * math.sqrt(len(trial.delta))
        after = self.system.linearise(trial.values, curvature=self.bend.curvature, lazy=settling)
        gain = self._gain(trial, after)
        if gain is None:
            self.status = Status.FLAT
            return
        try:
            accepted = self.rule.hear(gain)
        except StopIteration:
            flat = abs(self.cost - after.cost) <= 1e-12 * self.cost
            self.status = Status.FLAT if flat else Status.STUCK
            return
        self._note(trial, accepted)
        self.settled = accepted and settling
        if accepted:
            self._stand(trial.values, after)
            self.before = trial.decrement

    def solution(self) -> Solution:
        """The estimate as it stands."""
        system = self.system
        robust = any(table.loss.name != "squared" for table in system.tables)
        return Solution(
            values=self.values,
            cost=self.cost,
            chi2=system.chi2(self.values) if robust else self.cost,
            rows=system.rows,
            dof=system.rows - system.free.dof,
            status=self.status,
            decrement=0.0 if self.status is Status.EMPTY else self.decrement,
            history=tuple(self.history),
            made=self.made,
        )

    # --- inside ---------------------------------------------------------------------------------------------------

    def _stand(self, values: Values, at: Linearised) -> None:
        """Be at these values. Their H without curvature is made when it is asked for."""
        self.values, self.at, self.cost = values, at, at.cost
        system, bare = self.system, at.curvature == "none"
        self.made = lambda: at.hessian if bare else system.linearise(values).hessian

    def _chord_step(self) -> tuple[Array, float, bool] | None:
        """The full step by the factor of the step before, where that still serves."""
        if not self.settled:
            return None
        delta = self.factor.solve(self.at.gradient)
        predicted = dot(self.at.gradient, delta)
        return (delta, predicted, True) if predicted < (CHORD * self.decrement) ** 2 else None

    def _ahead(self, decrement: float) -> float:
        """How far from the optimum a step leaves us, by how much shorter it is than the one before (Deuflhard, "Newton
        Methods for Nonlinear Problems", 2011, ch. 2): each leaves a share of the distance that hardly grows any
        more."""
        return decrement * min(1.0, CAUTION * decrement / self.before) if self.before > 0.0 else decrement

    @cached_property
    def _rounding(self) -> float:
        """Of one residual, with room [sigmas]."""
        return 10.0 * self.system.rounding(self.start)

    def _visible(self) -> float:
        """The least difference of costs that rounding does not hide."""
        return self._rounding * math.sqrt(self.cost + 1.0)

    def _gain(self, trial: _Trial, after: Linearised) -> float | None:
        """The actual decrease over the predicted one; None where a full step is hidden by rounding and the decrement no
        longer falls, while a hidden step that is shorter than those before is trusted."""
        actual, predicted = self.cost - after.cost, trial.predicted
        gain = actual / predicted if predicted > 0.0 and math.isfinite(after.cost) else -math.inf
        if gain > FORETOLD and predicted > ROUNDING * self.cost:
            return gain
        # A sum of large terms of both signs rounds earlier than one of squares does.
        hidden = predicted <= self._visible() or (gain <= 0.0 and predicted <= ROUNDING * self.cost)
        if not (trial.is_full and hidden):
            return gain
        if not trial.decrement < 0.5 * self.best:
            return None
        self.best = trial.decrement
        return 1.0

    def _note(self, trial: _Trial, accepted: bool) -> None:
        largest, elapsed = float(np.abs(trial.delta).max()), time.perf_counter() - self.began
        self.history.append(Step(self.cost, trial.decrement, largest, self.rule.damping, accepted, elapsed))
        if self.progress is not None:
            self.progress(self.history[-1])
