"""A factor that has grown old, put right by what steps with it have seen of the gradient since.

    s  a step that was taken, y  by how much the gradient fell along it      (n,) each
    H^-1  <-  (1 - s y'/s'y) H^-1 (1 - y s'/s'y)  +  s s'/s'y                BFGS

Each step costs a gradient and a solve. What H lacks in a few directions, such as how submaps bend where their frames
turn, is learnt from a few steps, and they converge superlinearly. The pairs are applied to a vector one by one, and the
factor stays as it is (Nocedal & Wright, "Numerical Optimization", 2006, alg. 7.4).
"""

import math

from teamslam.geometry import Array
from teamslam.solver.linear import Factor
from teamslam.solver.rules import Proposal, dot

SHORTER = 0.84  # the share of the distance that steps may leave on average: four of them half of it
ROOM = 3.0  # how far one may fall behind that
CURVED = 1e-10  # the cosine between s and y above which a pair counts


class Secants:
    """The steps taken since the factor was made."""

    def __init__(self) -> None:
        self._pairs: list[tuple[Array, Array, float]] = []
        self._most = math.inf

    def begin(self) -> None:
        """The factor is made anew."""
        self._pairs.clear()
        self._most = math.inf

    def see(self, distance: float, step: Array, before: Array, after: Array) -> None:
        """Take note of a step that was taken, how far it was thought to go [sigmas], and of the gradients before and
        after it. Where the cost bends down along it, nothing is learnt."""
        self._most = SHORTER * (ROOM * distance if math.isinf(self._most) else self._most)
        fell = before - after
        bend = dot(step, fell)
        if bend > CURVED * math.sqrt(dot(step, step) * dot(fell, fell)):
            self._pairs.append((step, fell, bend))

    def step(self, factor: Factor, gradient: Array) -> Proposal | None:
        """H^-1 g; None where the factor no longer serves: steps have hardly come nearer since it was made."""
        delta = self._solve(factor, gradient)
        predicted = dot(gradient, delta)
        return Proposal(delta, predicted, True) if 0.0 <= predicted < self._most**2 else None

    def _solve(self, factor: Factor, gradient: Array) -> Array:
        shares: list[float] = []
        for step, fell, bend in reversed(self._pairs):
            shares.append(dot(step, gradient) / bend)
            gradient = gradient - shares[-1] * fell
        out = factor.solve(gradient)
        for (step, fell, bend), share in zip(self._pairs, reversed(shares), strict=True):
            out += (share - dot(fell, out) / bend) * step
        return out
