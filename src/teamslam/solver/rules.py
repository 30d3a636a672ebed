"""Step rules: Gauss-Newton, Levenberg-Marquardt and dogleg, as answers to one question: which step now?

Sources: Nocedal & Wright, "Numerical Optimization" (2006), ch. 4 and 10; Marquardt (1963); Powell (1970).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.solver.linear import Factor
from teamslam.solver.system import Linearised

FAIR = 0.75  # of the decrease that was predicted: what steps of this length can expect
ENOUGH = 1e-4  # of the decrease that was predicted: a step that gains less is not taken


@dataclass(frozen=True, eq=False)
class Proposal:
    """A step d, the decrease 2 g'd - d'Hd that the model predicts, whether d is the full Newton step, and the damping
    that was added to the diagonal of H for it, if any."""

    delta: Array
    predicted: float
    is_full: bool
    damping: Array | None = None


class Rule(Protocol):
    """A step rule: proposes a step, and hears what became of it."""

    damping: float
    corrects_below: float
    """The gain below which a step asks to be brought back to what stiff measurements hold."""

    def propose(self, factor: Factor, at: Linearised, insist: bool) -> Proposal:
        """The step to try. Raises SolveError where the (damped) matrix is not positive definite; where H has curvature
        and is indefinite, a rule that can should `insist` on it, and damp more."""

    def hear(self, gain: float) -> bool:
        """Whether to take a step whose actual decrease is `gain` times the predicted one. StopIteration where there is
        none left to try."""

    def reset(self) -> None:
        """Forget what was heard: the next step to be proposed is a full one."""


class GaussNewton:
    """The full step, always taken: fast near the optimum, without a safety net."""

    damping = 0.0
    corrects_below = -np.inf

    def propose(self, factor: Factor, at: Linearised, insist: bool) -> Proposal:
        factor.factorise(at.hessian.numbers)
        return full_step(factor, at)

    def hear(self, gain: float) -> bool:
        if not np.isfinite(gain):
            raise StopIteration
        return True

    def reset(self) -> None:
        pass


class LevenbergMarquardt:
    """The full step while it works; else (H + lambda S) d = g with lambda raised until the cost falls, S the diagonal
    of the information.

    Where H holds curvature and is indefinite, lambda is raised until H + lambda S is not: such steps are drawn along
    what bends down, and leave saddles (Nocedal & Wright, sec. 4.3).
    """

    corrects_below = FAIR
    _FIRST, _SMALLEST, _MOST = 1e-4, 1e-14, 1e12
    _LEAST = 1e-5  # of the first damping: less is none

    def __init__(self) -> None:
        self.damping, self._first, self._growth = 0.0, self._FIRST, 2.0
        self._indefinite = 0.0  # the most damping of late under which H was still indefinite
        self._tried: tuple[Linearised, Proposal] | None = None  # where the last full step was, and the step

    def propose(self, factor: Factor, at: Linearised, insist: bool) -> Proposal:
        if self.damping == 0.0:
            try:
                factor.factorise(at.hessian.numbers)
            except SolveError:
                if not (at.scale > 0.0).all() or (at.curvature != "none" and not insist):
                    raise  # a variable that nothing measures: damping would only hide it
                self.damping = self._first = self._FIRST
            else:
                step = full_step(factor, at)
                self._tried = (at, step)
                return step
        damping = self._positive(factor, at, insist)
        delta = factor.solve(at.gradient)
        return Proposal(delta, dot(at.gradient + damping * delta, delta), False, damping)

    def hear(self, gain: float) -> bool:
        if gain > ENOUGH:
            # Nielsen (1999): the better the prediction, the less damping.
            less = self.damping * max(1.0 / 10.0, 1.0 - (2.0 * min(gain, 1.5) - 1.0) ** 3)
            if less <= self._indefinite < self.damping:
                less = float(np.sqrt(self._indefinite * self.damping))
            self._indefinite *= 0.5
            self.damping = 0.0 if less < self._LEAST * self._first else less
            self._growth = 2.0
            return True
        if self.damping == 0.0:
            self.damping = self._first = self._beginning()
        else:
            self.damping *= self._growth
            self._growth *= 2.0
        if self.damping > self._MOST:
            raise StopIteration
        return False

    def _positive(self, factor: Factor, at: Linearised, insist: bool) -> Array:
        """Factorise H damped, and more so where that is indefinite; the damping."""
        while True:
            damping = self.damping * at.scale
            try:
                factor.factorise(at.hessian.numbers, damping)
                return damping
            except SolveError:
                if self.damping > self._MOST or (at.curvature != "none" and not insist):
                    raise
                self._indefinite = self.damping
                self.damping *= 3.0

    def reset(self) -> None:
        self.damping, self._first, self._growth = 0.0, self._FIRST, 2.0

    def _beginning(self) -> float:
        """What damps the full step that failed by about as much as H itself: on stiff measurements beside weak ones the
        usual beginning would hold everything in place."""
        assert self._tried is not None
        at, step = self._tried
        share = step.predicted / max(dot(at.scale * step.delta, step.delta), 1e-300)
        return min(max(share, self._SMALLEST), self._FIRST)


class Dogleg:
    """Powell's dogleg: within a trust region, along steepest descent and then towards the Gauss-Newton step.

    Lengths are measured in the metric of S, the diagonal of the information, so that metres and radians compare.
    """

    corrects_below = FAIR

    def __init__(self) -> None:
        self.damping = np.inf  # the trust radius, in sigmas; the first Gauss-Newton step sets the scale
        self._at_edge = False

    def propose(self, factor: Factor, at: Linearised, insist: bool) -> Proposal:
        factor.factorise(at.hessian.numbers)
        full = full_step(factor, at)
        newton = full.delta
        metric = np.sqrt(at.scale)
        length = float(np.linalg.norm(metric * newton))
        if length <= self.damping:
            if not np.isfinite(self.damping):
                self.damping = length
            self._at_edge = False
            return full
        matrix = at.hessian.to_csr()
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
        return Proposal(delta, float(2.0 * at.gradient @ delta - delta @ (matrix @ delta)), False)

    def hear(self, gain: float) -> bool:
        if gain > 0.75 and self._at_edge:
            self.damping *= 2.0
        elif not gain > 0.25:
            self.damping *= 0.25
        if self.damping < 1e-12:
            raise StopIteration
        return gain > ENOUGH

    def reset(self) -> None:
        self.damping, self._at_edge = np.inf, False


RULES: dict[str, Callable[[], Rule]] = {
    "levenberg_marquardt": LevenbergMarquardt,
    "gauss_newton": GaussNewton,
    "dogleg": Dogleg,
}


def full_step(factor: Factor, at: Linearised) -> Proposal:
    """H^-1 g, by the factor at hand."""
    delta = factor.solve(at.gradient)
    return Proposal(delta, dot(at.gradient, delta), True)


def dot(a: Array, b: Array) -> float:
    """a'b, without the threads of a BLAS: waking them takes longer than the sum."""
    return float(np.sum(a * b))
