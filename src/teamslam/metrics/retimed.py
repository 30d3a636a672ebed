"""How late the stamps of a truth are: those of motion capture are another computer's.

    min over d of   min over rigid X of   sum | p_i - X q(s_i + d) |^2          p a robot's positions, q its true ones

by a search over a second to either side and Newton's steps from the best. The map's errors hang together in time, so
the positions count as (1 - r) / (1 + r) as many, r how much of an error is left in the next.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.clock import Clock
from teamslam.geometry import Array, align

REACH_S, STEP_S, FINE_S = 1.0, 0.05, 0.01
ROUNDS = 6
FEWEST = 10


@dataclass(frozen=True)
class Late:
    """By how much the stamps of a truth are late in the `middle` [ticks] of a robot's way, and by how much more in a
    second (`drift`, 0 where that is not told), with their standard deviations [s, 1]: that of a drift which is not told
    is what it would be told with, infinite where nobody asked."""

    value_s: float
    sigma_s: float
    drift: float = 0.0
    drift_sigma: float = np.inf
    middle: int = 0

    @property
    def clock(self) -> Clock:
        """The clock of the truth beside the robot's."""
        return Clock(self.middle, self.value_s, self.drift)


def late_truth(stamps_s: Array, positions: Array, true_stamps_s: Array, true_positions: Array) -> Late | None:
    """How late a truth of positions (k, d) at rising stamps (k,) is, for a robot that was at `positions` (n, d) at
    `stamps_s` (n,), each in a frame of its own; None where its way does not tell it."""

    def off(late: float) -> Array | None:
        """What is left (m, d) after the best alignment."""
        at = stamps_s + late
        inside = (at >= true_stamps_s[0]) & (at <= true_stamps_s[-1])
        if np.count_nonzero(inside) < FEWEST:
            return None
        true = np.stack([np.interp(at[inside], true_stamps_s, axis) for axis in true_positions.T], -1)
        return np.asarray(align(true, positions[inside]).pose.act(true) - positions[inside])

    def cost(late: float) -> float:
        left = off(late)
        return np.inf if left is None else float(np.mean(np.sum(left**2, -1)))

    if len(true_stamps_s) < 2:
        return None
    late = min(np.arange(-REACH_S, REACH_S + STEP_S / 2, STEP_S).tolist(), key=cost)
    for _ in range(ROUNDS):
        here, before, after = cost(late), cost(late - FINE_S), cost(late + FINE_S)
        bend = (before - 2.0 * here + after) / FINE_S**2
        if not (np.isfinite(bend) and bend > 0.0):
            return None
        late -= float(np.clip((after - before) / (2.0 * FINE_S) / bend, -STEP_S, STEP_S))
    left = off(late)
    if left is None:
        return None
    hangs = float(np.clip(np.sum(left[1:] * left[:-1]) / max(np.sum(left**2), 1e-300), 0.0, 0.95))
    count = max(len(left) * (1.0 - hangs) / (1.0 + hangs), 1.0)
    variance = np.sum(left**2) / len(left) / left.shape[1]
    return Late(late, float(np.sqrt(2.0 * variance / (count * bend))))
