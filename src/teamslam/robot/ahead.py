"""What the map knows of the landmarks about the pose at which a filter begins: told when one is seen.

    y_j | y_s = m_j + G (y_s - m_s)      G = S_js S_ss^-1      left over: S_jj - G S_sj

of the map's Gaussian (m, S) over the pose where the filter begins and the landmarks about it; s are those that the
filter holds already, j one that it sees now for the first time. The filter that takes it in then holds what it would
hold if it had carried it from the start, to first order and at a cost that goes with what it has seen, not with what
may be seen.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.robot.order import Order


@dataclass(frozen=True, eq=False)
class Ahead:
    """The map's Gaussian: `frame`, the key of the pose (or WORLD) that it is written in; `order`, the pose and then
    landmarks, none of which turns; `state`, `covariance` (n, n)."""

    frame: int
    order: Order
    state: Array
    covariance: Array

    def conditional(self, known: IntArray, new: IntArray) -> tuple[Array, Array] | None:
        """G and what is left over of the variables at places `new`, given those at places `known`; None where these
        hang together so firmly that nothing can be said."""
        s, j = self.order.columns(known), self.order.columns(new)
        loose = np.diagonal(self.covariance)[s] > 0.0
        G = np.zeros((len(j), len(s)))
        across = self.covariance[np.ix_(s[loose], j)]
        try:
            G[:, loose] = np.linalg.solve(self.covariance[np.ix_(s[loose], s[loose])], across).T
        except np.linalg.LinAlgError:
            return None
        return G, self.covariance[np.ix_(j, j)] - G[:, loose] @ across

    def moved(self, known: IntArray, state: Array, new: IntArray, G: Array) -> Array:
        """Where the variables at places `new` are, given the state of those at places `known`."""
        held, come = self.order.only(known), self.order.only(new)
        shift = held.minus(state, self.state[self.order.rows(known)])
        return come.retract(self.state[self.order.rows(new)], G @ shift, np.zeros(2))
