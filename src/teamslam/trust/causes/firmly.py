"""How firmly the rest of a problem holds each of its rows: what all others say of it, and how surely.

With H the information of all rows at the weights w of their losses, A the row's own derivative and u what it leaves,
both whitened, M = A H^-1 A'. Without the row the estimate moves to where that leaves (1 - M w)^-1 u, of covariance

    S = 1 + M (1 - w M)^-1

under the rest's noise and its own, and T = u' S^-1 u is chi-square where it is right (Baarda's data snooping, for rows
of several numbers).
"""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Values
from teamslam.model.sparse import sp
from teamslam.solver import Factor, System

AT_ONCE = 8  # rows of which it is asked together
EDGE = 1e-9  # of a row's own information: what the rest has no more of than that is held by the row alone


class Firmly:
    """How firmly the rest of a problem holds each of its rows, at one point."""

    def __init__(self, system: System, there: Values, weights: Sequence[Array]) -> None:
        self.system, self.there = system, there
        at = system.linearise(there)
        self.factor: Factor = system.factor(there)
        self.factor.factorise(at.hessian.numbers)
        self.whitened = [system.whitened(n, there) for n in range(len(system.tables))]
        both = zip(system.tables, self.whitened, weights, strict=True)
        self.weights = [w * table.loss.weight(np.sum(u**2, -1)) for table, u, w in both]
        self._jacobians: dict[int, sp.csr_array] = {}

    def sizes(self, at: int, rows: IntArray) -> Iterator[tuple[float, Array]]:
        """Of each row by itself T, and S, the covariance of what it and the rest leave between them (r, r)."""
        for first in range(0, len(rows), AT_ONCE):
            some = rows[first : first + AT_ONCE]
            taken, r = self._taken(at, some), self.whitened[at].shape[1]
            for n, row in enumerate(some.tolist()):
                own = slice(n * r, (n + 1) * r)
                u, spread = _alone(taken[own, own], np.full(r, self.weights[at][row]), self.whitened[at][row])
                yield float(u @ np.linalg.solve(spread, u)), spread

    def beside(self, at: int, row: int, other: int) -> float:
        """T of a row where another is left out."""
        r, both = self.whitened[at].shape[1], np.array([row, other])
        u, spread = _alone(self._taken(at, both), np.repeat(self.weights[at][both], r), self.whitened[at][both].ravel())
        return float(u[:r] @ np.linalg.solve(spread[:r, :r], u[:r]))

    def _taken(self, at: int, rows: IntArray) -> Array:
        """A H^-1 A' of some rows of a table together."""
        if at not in self._jacobians:
            self._jacobians[at] = self.system.jacobian(at, self.there)
        r = self.whitened[at].shape[1]
        mine = self._jacobians[at][(rows[:, None] * r + np.arange(r)).ravel()]
        return np.asarray(mine @ self.factor.solve(mine.T.toarray()))


def _alone(taken: Array, weights: Array, whitened: Array) -> tuple[Array, Array]:
    """Residuals of rows that were left out, (1 - M w)^-1 u, and their covariance 1 + M (1 - w M)^-1, M = A H^-1 A'."""
    unit, w = np.eye(len(taken)), np.diag(weights * (1.0 - EDGE))
    spread = unit + np.linalg.solve((unit - w @ taken).T, taken.T).T
    return np.asarray(np.linalg.solve(unit - taken @ w, whitened)), np.asarray(spread)
