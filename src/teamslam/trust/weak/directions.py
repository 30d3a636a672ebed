"""The weakest direction of a map: the displacement that carries most of what is uncertain in its shape.

    P v = mu M^-1 v,  mu the largest            the first principal axis of P in the metric M

and once combinations F of the unknowns are taken as known, that of P - P F' (F P F')^-1 F P. Whether any direction
stands out is asked first, of a few steps of Lanczos from a random start: theta, the largest eigenvalue of
A = M^1/2 P M^1/2 in

    span(w, A w, ..., A^(k-1) w),      w random (dof,)

is never more than mu. That theta < tau though mu > tau takes a start nearly at right angles with v: its part w_1 along
v (standard normal) has, with T_n the polynomials of Chebyshev, the mean of all w_j^2 weighed by variance as one, and
variances as shares of their sum,

    w_1^2 < tau^2 / 4 / ((mu - tau) mu^2 T_(k-2)(2 mu / tau - 1)^2)

by the polynomial p(x) = x T_(k-2)(2 x / tau - 1), no larger than x up to tau. At k = 8, mu = 0.2 and tau = mu / 2 that
is |w_1| < 4e-5: three starts of 100,000. Source: Kuczynski, Wozniakowski, "Estimating the largest eigenvalue by the
power and Lanczos algorithms with a random start" (1992).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.trust.weak.knowledge import DENSE, Knowledge, Stacks, worst_variances
from teamslam.trust.weak.motions import turns

ROUNDING = 1e-9  # of a correlation
STEPS = 8  # of Lanczos: k
NEARLY = 0.5  # of what stands out, that theta hardly ever falls short of: tau / mu


@dataclass(frozen=True)
class Least:
    """The largest standard deviation of any place [m] and of any heading or turn [rad] (0 where nothing has one), and
    the keys of these."""

    place_m: float
    place: int
    heading_rad: float
    heading: int


@dataclass(frozen=True, eq=False)
class Conditioned:
    """What is known once the combinations `functions` (dof, k) of the unknowns are known too."""

    knowledge: Knowledge
    functions: Array

    @cached_property
    def _gone(self) -> Array:
        """X (dof, k) with P given F = P - X X'."""
        spread = self.knowledge.spread(self.functions)
        together = self.functions.T @ spread
        scale = np.sqrt(np.diagonal(together))
        sizes, ways = np.linalg.eigh(together / np.outer(scale, scale))
        fresh = sizes > ROUNDING  # combinations that others of them tell as well add nothing
        return np.asarray((spread / scale) @ (ways[:, fresh] / np.sqrt(sizes[fresh])))

    def spread(self, f: Array) -> Array:
        """The covariance times functions f (dof, ...)."""
        found = self.knowledge.spread(f)
        return np.asarray(found - self._gone @ (self._gone.T @ f))

    def few(self, which: IntArray) -> Stacks:
        """The covariance of some variables, by their places."""
        parts = ((at, blocks, self._gone[at]) for at, blocks in self.knowledge.few(which))
        return [(at, blocks - x @ np.swapaxes(x, 1, 2)) for at, blocks, x in parts]

    @cached_property
    def least(self) -> "Least":
        """What is known least, relative to the map as a whole."""
        layout = self.knowledge.values.layout
        # What is known exactly has a variance of zero, give or take rounding.
        variances = np.maximum(self.knowledge.variances - np.sum(self._gone**2, 1), 0.0)
        turning = turns(layout)
        place, place_m = self._worst(np.where(turning, 0.0, variances), 0)
        heading, heading_rad = self._worst(np.where(turning, variances, 0.0), 1)
        return Least(place_m, int(layout.keys[place]), heading_rad, int(layout.keys[heading]))

    def _worst(self, variances: Array, which: int) -> tuple[int, float]:
        """The variable with the largest standard deviation in any direction, of its place (0) or its turn (1), where
        `variances` has those of each axis: only those are looked at whose axes together have more than the first."""
        layout = self.knowledge.values.layout
        sums = np.add.reduceat(variances, layout.dof_start[:-1])
        first = worst_variances(layout, self.few(np.argmax(sums, keepdims=True)))[which]
        rivals = np.flatnonzero(sums >= np.nanmax(first, initial=0.0))
        worst = np.nan_to_num(worst_variances(layout, self.few(rivals))[which])
        return (top := int(np.argmax(worst))), float(np.sqrt(max(worst[top], 0.0)))

    @property
    def total(self) -> float:
        """The sum of all variances, in the metric: what its directions share among them."""
        known = self.knowledge
        return known.total - float(np.sum(known.weight[:, None] * self._gone**2))

    def weakest(self) -> tuple[Array, float]:
        """The direction v (dof,), of length one in M, and its variance mu."""
        root = np.sqrt(self.knowledge.weight)
        dof = len(root)
        if dof <= DENSE:
            values, vectors = np.linalg.eigh(self._times(np.eye(dof)))
            return vectors[:, -1] / root, float(values[-1])
        from scipy.sparse.linalg import LinearOperator, eigsh

        operator = LinearOperator((dof, dof), matvec=self._times, matmat=self._times, dtype=float)
        start, _ = self._sketch
        values, vectors = eigsh(operator, k=1, v0=start, which="LA", tol=1e-6)
        return vectors[:, 0] / root, float(values[0])

    def may_carry(self, share: float) -> bool:
        """Whether some direction may carry a `share` of all that is uncertain: no, if theta falls far short of it."""
        if len(self.knowledge.weight) <= DENSE:
            return True
        return self._sketch[1] >= NEARLY * share * self.total

    def _times(self, y: Array) -> Array:
        """A y, for y (dof, ...)."""
        root = np.sqrt(self.knowledge.weight)
        return np.asarray((root * self.spread((root * np.asarray(y).T).T).T).T)

    @cached_property
    def _sketch(self) -> tuple[Array, float]:
        """The weakest direction (dof,) among a few of Krylov's, and its variance theta."""
        y = np.random.default_rng(0).standard_normal(len(self.knowledge.weight))
        Q, AQ = (np.zeros((STEPS, len(y))) for _ in range(2))
        for step in range(STEPS):
            for _ in range(2):
                y = y - Q[:step].T @ (Q[:step] @ y)
            Q[step] = y / (np.linalg.norm(y) or 1.0)
            y = AQ[step] = self._times(Q[step])
        values, ways = np.linalg.eigh(Q @ AQ.T)
        return ways[:, -1] @ Q, float(values[-1])
