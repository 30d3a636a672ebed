"""Step rules: Gauss-Newton, Levenberg-Marquardt and dogleg, as answers to one question: which step now?

Sources: Nocedal & Wright, "Numerical Optimization" (2006), ch. 4 and 10; Marquardt (1963); Powell (1970).
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.solver.linear import Factor
from teamslam.solver.system import Linearised


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
        return delta, dot(at.gradient, delta), True

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
                return delta, dot(at.gradient, delta), True
        damping = self.damping * at.hessian.diagonal()
        factor.factorise(at.hessian.numbers, damping)
        delta = factor.solve(at.gradient)
        return delta, dot(at.gradient + damping * delta, delta), False

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


def dot(a: Array, b: Array) -> float:
    """a'b, without the threads of a BLAS: waking them takes longer than the sum."""
    return float(np.sum(a * b))
