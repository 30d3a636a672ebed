"""Ways down from a saddle: where the gradient is zero and yet the cost bends down, between two basins of a loss that
forgives.

The direction is that of the most negative curvature relative to the information's diagonal S, by inverse iteration with
the factor of H + lambda S, lambda just large enough (Nocedal & Wright, "Numerical Optimization" 2006, sec. 4.3: the
hard case).
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.solver.linear import Factor
from teamslam.solver.rules import dot
from teamslam.solver.system import Linearised

_LEAST, _MOST = 1e-6, 1e3  # lambda
_ITERATIONS = 12
_FLAT = 1e-10  # curvature, relative to S, that rounding may have made


@dataclass(frozen=True, eq=False)
class Way:
    """A direction v of unit length in the metric of S, with g'v >= 0 and v'Hv < 0."""

    direction: Array
    slope: float
    bend: float

    def decrease(self, length: float) -> float:
        """What the model promises for going so far: 2 g'd - d'Hd."""
        return length * (2.0 * self.slope - length * self.bend)


def way_down(factor: Factor, at: Linearised) -> Way | None:
    """A direction in which the cost bends down; None where H is positive definite, or flat to rounding. `factor` is
    left with what it took to see that."""
    numbers, scale, damping = at.hessian.numbers, at.scale, 0.0
    while not _is_positive(factor, numbers, damping * scale):
        damping = max(_LEAST, 10.0 * damping)
        if damping > _MOST:
            return None
    if damping == 0.0:
        return None
    v = np.random.default_rng(0).standard_normal(len(scale))
    for _ in range(_ITERATIONS):
        v = factor.solve(scale * v / np.sqrt(dot(scale * v, v)))
    v /= np.sqrt(dot(scale * v, v))
    bend, slope = float(v @ (at.hessian.to_csr() @ v)), dot(at.gradient, v)
    if bend >= -_FLAT:
        return None
    return Way(v if slope >= 0.0 else -v, abs(slope), bend)


def _is_positive(factor: Factor, numbers: Array, damping: Array) -> bool:
    try:
        factor.factorise(numbers, damping)
    except SolveError:
        return False
    return True
