"""One loop for every least-squares problem; Gauss-Newton, Levenberg-Marquardt and dogleg are step rules.

    repeat   linearise -> ask the rule for a step d -> try x (+) d -> tell the rule how well the model predicted

Near the optimum H hardly changes any more, so there steps go on with the factor at hand (the chord method) while each
of them shrinks the gradient tenfold.

It stops on the Newton decrement sqrt(g' H^-1 g): the distance to the optimum of the model in sigmas, so that no
variable, and no combination of them, is farther from the optimum than that many of its own standard deviations. That is
a test on the gradient, in the only norm that knows the units; the cost alone never counts as convergence. Where the
rounding of the cost hides progress, full steps go on while the decrement falls; what it takes for them to converge fast
is in `newton`.
Sources: Nocedal & Wright, "Numerical Optimization" (2006), ch. 4 and 10; Marquardt (1963); Powell (1970).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from teamslam.errors import InputError, SolveError
from teamslam.geometry import Array
from teamslam.model import Values
from teamslam.solver.linear import Factor, Matrix
from teamslam.solver.newton import Bend
from teamslam.solver.system import Linearised, System


@dataclass(frozen=True)
class Options:
    """How to solve.

    `rule`: a row of RULES. It has converged when the Newton decrement is at most `decrement` [sigmas], or when the
    decrease still to be had after a step is below `cost_share` of the cost. Raises InputError for values that make no
    sense.
    """

    rule: str = "levenberg_marquardt"
    max_iterations: int = 300
    decrement: float = 1e-6
    cost_share: float = 1e-20

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise InputError(f"unknown step rule '{self.rule}'; choose one of {', '.join(RULES)}")
        if self.max_iterations < 1:
            raise InputError(f"max_iterations is at least 1, found {self.max_iterations}")
        if not (self.decrement > 0.0 and self.cost_share >= 0.0):
            raise InputError("decrement must be above zero and cost_share not below it")


class Status(Enum):
    """How a run ended, as a sentence."""

    CONVERGED = "Converged: the gradient is zero to within the tolerance, in sigmas of every variable."
    FLAT = "Converged: no step lowers the cost any more, and what is left is rounding."
    EMPTY = "Nothing to estimate: every variable is fixed."
    MAX_ITERATIONS = "Stopped at the limit of iterations before the gradient was small enough."
    STUCK = "Stopped: no step lowers the cost although the gradient is not small; the start may be too far off."

    @property
    def converged(self) -> bool:
        """True where the estimate is a (local) optimum."""
        return self in (Status.CONVERGED, Status.FLAT, Status.EMPTY)


@dataclass(frozen=True)
class Step:
    """One iteration: the cost before it, the Newton decrement [sigmas] (nan where the step was damped), the largest
    change, the damping or trust radius, whether it was taken, and the seconds since the start."""

    cost: float
    decrement: float
    step_norm: float
    damping: float
    accepted: bool
    seconds: float


@dataclass(frozen=True, eq=False)
class Solution:
    """An estimate and how it came about.

    `cost` = sum of losses, `chi2` = sum of squared whitened residuals (equal for the squared loss), both without a
    factor 1/2; `rows` numbers measured, `dof` = rows - unknowns; `decrement` how far the optimum still is at most, in
    sigmas, where it has converged; `hessian` H at the estimate, over the free unknowns.
    """

    values: Values
    cost: float
    chi2: float
    rows: int
    dof: int
    status: Status
    decrement: float
    history: tuple[Step, ...]
    hessian: Matrix

    @cached_property
    def information(self) -> sp.csr_array:
        """H at the estimate as a sparse matrix."""
        return self.hessian.to_csr()

    @property
    def converged(self) -> bool:
        """True where the estimate is a (local) optimum."""
        return self.status.converged

    @property
    def iterations(self) -> int:
        """Steps tried."""
        return len(self.history)


class Rule(Protocol):
    """A step rule: proposes a step, and hears what became of it."""

    damping: float

    def propose(self, factor: Factor, at: Linearised) -> tuple[Array, float, bool]:
        """A step d, the decrease 2 g'd - d'Hd that the model predicts, and whether d is the full Gauss-Newton step.

        Raises SolveError where the (damped) matrix is not positive definite."""

    def hear(self, gain: float) -> bool:
        """Whether to take a step whose actual decrease is `gain` times the predicted one."""


class GaussNewton:
    """The full step, always taken: fast near the optimum, without a safety net."""

    damping = 0.0

    def propose(self, factor: Factor, at: Linearised) -> tuple[Array, float, bool]:
        factor.factorise(at.hessian.numbers)
        delta = factor.solve(at.gradient)
        return delta, _dot(at.gradient, delta), True

    def hear(self, gain: float) -> bool:
        return bool(np.isfinite(gain))


class LevenbergMarquardt:
    """The Gauss-Newton step while it works; else (H + lambda diag H) d = g with lambda raised until the cost falls."""

    _FIRST, _MOST, _LEAST = 1e-4, 1e12, 1e-9

    def __init__(self) -> None:
        self.damping = 0.0
        self._growth = 2.0

    def propose(self, factor: Factor, at: Linearised) -> tuple[Array, float, bool]:
        if self.damping == 0.0:
            try:
                factor.factorise(at.hessian.numbers)
            except SolveError:
                if not (at.hessian.diagonal() > 0.0).all():
                    raise  # a variable that nothing measures: damping would only hide it
                self.damping = self._FIRST
            else:
                delta = factor.solve(at.gradient)
                return delta, _dot(at.gradient, delta), True
        damping = self.damping * at.hessian.diagonal()
        factor.factorise(at.hessian.numbers, damping)
        delta = factor.solve(at.gradient)
        return delta, _dot(at.gradient + damping * delta, delta), False

    def hear(self, gain: float) -> bool:
        if gain > 1e-4:
            # Nielsen (1999): the better the prediction, the less damping.
            self.damping *= max(1.0 / 10.0, 1.0 - (2.0 * min(gain, 1.5) - 1.0) ** 3)
            self.damping = 0.0 if self.damping < self._LEAST else self.damping
            self._growth = 2.0
            return True
        self.damping = self.damping * self._growth or self._FIRST
        self._growth *= 2.0
        if self.damping > self._MOST:
            raise StopIteration
        return False


class Dogleg:
    """Powell's dogleg: within a trust region, along steepest descent and then towards the Gauss-Newton step.

    Lengths are measured in the metric of diag H, so that metres and radians compare.
    """

    def __init__(self) -> None:
        self.damping = np.inf  # the trust radius, in sigmas; the first Gauss-Newton step sets the scale
        self._at_edge = False

    def propose(self, factor: Factor, at: Linearised) -> tuple[Array, float, bool]:
        factor.factorise(at.hessian.numbers)
        newton = factor.solve(at.gradient)
        metric = np.sqrt(at.hessian.diagonal())
        matrix = at.hessian.to_csr()
        length = float(np.linalg.norm(metric * newton))
        if length <= self.damping:
            if not np.isfinite(self.damping):
                self.damping = length
            self._at_edge = False
            return newton, float(at.gradient @ newton), True
        descent = at.gradient / metric**2
        cauchy = descent * float((at.gradient @ descent) / (descent @ (matrix @ descent)))
        short = float(np.linalg.norm(metric * cauchy))
        self._at_edge = True
        if short >= self.damping:
            delta = cauchy * (self.damping / short)
        else:
            along = newton - cauchy
            a = float(np.sum((metric * along) ** 2))
            b = float(np.sum(metric**2 * cauchy * along))
            c = short**2 - self.damping**2
            delta = cauchy + along * ((-b + np.sqrt(b * b - a * c)) / a)
        return delta, float(2.0 * at.gradient @ delta - delta @ (matrix @ delta)), False

    def hear(self, gain: float) -> bool:
        if gain > 0.75 and self._at_edge:
            self.damping *= 2.0
        elif not gain > 0.25:
            self.damping *= 0.25
        if self.damping < 1e-12:
            raise StopIteration
        return gain > 1e-4


RULES: dict[str, Callable[[], Rule]] = {
    "levenberg_marquardt": LevenbergMarquardt,
    "gauss_newton": GaussNewton,
    "dogleg": Dogleg,
}

DEFAULTS = Options()
_SETTLED = 0.3  # [sigmas of an unknown, on average]: a step this small leaves H nearly as it is
_CAUTION = 4.0  # how much larger the share that a step leaves may be than that of the step before
_ROUNDING = 1e-10  # of the cost: a full step that promises less, and gains nothing, is at the end of what can be seen


def optimise(
    system: System,
    start: Values,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
    factor: Factor | None = None,
) -> Solution:
    """The values that minimise the system's cost, from `start`.

    The information returned is H = J'W'WJ at the estimate, not damped. Raises SolveError where the measurements do not
    determine a variable, naming it.
    """
    began = time.perf_counter()
    values, rule, history = start, RULES[options.rule](), list[Step]()
    at = system.linearise(values)
    if not np.isfinite(at.cost):
        raise SolveError("the cost is not finite at the start values; look for infinite or coincident start values")
    if system.free.dof == 0:
        return _solution(system, values, at, Status.EMPTY, 0.0, history)
    if factor is None:
        factor = system.factor(start)
    status, decrement, before, best = Status.MAX_ITERATIONS, np.inf, np.nan, np.inf
    floor, bend, settled = 10.0 * system.rounding(start), Bend(), False
    while len(history) < options.max_iterations:
        try:
            again = _chord_step(factor, at, decrement) if settled else None
            delta, predicted, full_step = again or rule.propose(factor, at)
        except SolveError:
            if not bend.retreat():
                raise
            settled, at = False, system.linearise(values)
            continue
        distance = float(np.sqrt(max(predicted, 0.0)))
        decrement = distance if full_step else np.nan
        candidate = system.retract(values, delta)
        ahead = _ahead(decrement, before)
        small = full_step and (decrement <= options.decrement or ahead**2 <= options.cost_share * at.cost)
        settling = full_step and decrement < _SETTLED * np.sqrt(len(delta))
        bend.see(distance)
        after = system.linearise(candidate, curvature="none" if small else bend.curvature, lazy=settling and not small)
        actual = at.cost - after.cost
        if small:
            # The last step is far below what matters; it is taken unless rounding makes it worse than it is worth.
            taken = np.isfinite(after.cost) and actual >= -1e-9 * at.cost - floor * np.sqrt(at.cost + 1.0)
            largest = float(np.abs(delta).max())
            history.append(Step(at.cost, decrement, largest, rule.damping, bool(taken), _since(began)))
            values, at = (candidate, after) if taken else (values, at)
            status, decrement = Status.CONVERGED, ahead
            break
        gain = actual / predicted if predicted > 0.0 and np.isfinite(after.cost) else -np.inf
        # A sum of large terms of both signs rounds earlier than one of squares does.
        hidden = predicted <= floor * np.sqrt(at.cost + 1.0) or (gain <= 0.0 and predicted <= _ROUNDING * at.cost)
        if full_step and hidden:
            # Too small a decrease to be seen in the cost: the full step is trusted while the decrement still falls.
            if not decrement < 0.5 * best:
                status = Status.FLAT
                break
            best, gain = decrement, 1.0
        try:
            accepted = rule.hear(gain)
        except StopIteration:
            flat = abs(actual) <= 1e-12 * at.cost
            status = Status.FLAT if flat else Status.STUCK
            break
        history.append(Step(at.cost, decrement, float(np.abs(delta).max()), rule.damping, accepted, _since(began)))
        if progress is not None:
            progress(history[-1])
        settled = accepted and settling
        if accepted:
            values, at, before = candidate, after, decrement
    return _solution(system, values, at, status, decrement, history)


def _ahead(decrement: float, before: float) -> float:
    """How far from the optimum a step leaves us, by how much shorter it is than the one before (Deuflhard, "Newton
    Methods for Nonlinear Problems", 2011, ch. 2): each leaves a share of the distance that hardly grows any more."""
    return decrement * min(1.0, _CAUTION * decrement / before) if before > 0.0 else decrement


def _chord_step(factor: Factor, at: Linearised, before: float) -> tuple[Array, float, bool] | None:
    """The full step, by the factor of the step before, where its decrement is a tenth of that step's at most."""
    delta = factor.solve(at.gradient)
    predicted = _dot(at.gradient, delta)
    return (delta, predicted, True) if predicted < (0.1 * before) ** 2 else None


def convex_start(system: System, start: Values, options: Options = DEFAULTS) -> Values:
    """A better start where losses forgive far outliers: under those, a start may lie beyond what they still see.

    Huber's loss of the same scale has one basin for each row; it is solved first, roughly. Where no loss forgives,
    `start`.
    """
    convex = system.convex()
    if convex is system:
        return start
    return optimise(convex, start, replace(options, decrement=max(options.decrement, 0.1))).values


def _solution(
    system: System, values: Values, at: Linearised, status: Status, decrement: float, history: list[Step]
) -> Solution:
    robust = any(table.loss.name != "squared" for table in system.tables)
    return Solution(
        values=values,
        cost=at.cost,
        chi2=system.chi2(values) if robust else at.cost,
        rows=system.rows,
        dof=system.rows - system.free.dof,
        status=status,
        decrement=decrement,
        history=tuple(history),
        hessian=at.hessian if at.curvature == "none" else system.linearise(values).hessian,
    )


def _dot(a: Array, b: Array) -> float:
    """a'b, without the threads of a BLAS: waking them takes longer than the sum."""
    return float(np.sum(a * b))


def _since(began: float) -> float:
    return time.perf_counter() - began
