"""What a solve gives: the estimate, how it came about, and how it ended, as a sentence."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any

from teamslam.model import Values
from teamslam.model.sparse import sp
from teamslam.solver.linear import Matrix

SAME = 1e-6  # of the cost, and absolutely: two optima that differ by less are one
SENSELESS = 3.0  # times its degrees of freedom in cost: what fits costs about one of each


class Status(Enum):
    """How a run ended, as a sentence."""

    CONVERGED = "Converged: the gradient is zero to within the tolerance, in sigmas of every variable."
    FLAT = "Converged: no step lowers the cost any more, and what is left is rounding."
    EMPTY = "Nothing to estimate: every variable is fixed."
    MAX_ITERATIONS = "Stopped at the limit of iterations before the gradient was small enough."
    INEXACT = "Stopped: no optimum of all rows was found; this is the join of the submaps, each in place of its rows."
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
class Held:
    """Makes a matrix that is there already."""

    matrix: Matrix

    def __call__(self) -> Matrix:
        return self.matrix


@dataclass(frozen=True, eq=False)
class Solution:
    """An estimate and how it came about.

    `cost` = sum of losses, `chi2` = sum of squared whitened residuals (equal for the squared loss), both without a
    factor 1/2; `rows` numbers measured, `dof` = rows - unknowns; `decrement` how far the optimum still is at most, in
    sigmas, where it has converged; inf where it has not, and H has no factor to tell by. `made` makes H at the
    estimate, over the free unknowns, when it is first asked for.
    """

    values: Values
    cost: float
    chi2: float
    rows: int
    dof: int
    status: Status
    decrement: float
    history: tuple[Step, ...] = field(repr=False)
    made: Callable[[], Matrix] = field(repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """What travels: H, in place of what makes it."""
        return vars(self) | {"made": Held(self.hessian), "hessian": self.hessian}

    @cached_property
    def hessian(self) -> Matrix:
        """H at the estimate, over the free unknowns, without any damping or curvature."""
        return self.made()

    @cached_property
    def information(self) -> sp.csr_array:
        """H at the estimate as a sparse matrix."""
        return self.hessian.to_csr()

    @property
    def converged(self) -> bool:
        """True where the estimate is a (local) optimum."""
        return self.status.converged

    @property
    def senseless(self) -> bool:
        """Whether it costs so much more than noise explains that another optimum, which fits, may have been missed."""
        return self.cost > SENSELESS * max(self.dof, 1)

    def is_lower_than(self, other: "Solution") -> bool:
        """Whether it is an optimum that costs less, by more than rounding."""
        return self.converged and self.cost < other.cost - SAME * (1.0 + other.cost)

    @property
    def iterations(self) -> int:
        """Steps tried."""
        return len(self.history)
