"""How much odometry slips: the restricted score of each slip's theta, and a step of theta towards its likeliest.

    Q_k  =  sum_i l_i' B_ik l_i ,   l = C^-1 left         held against what errors drawn from the model make of it

What scales alone explain is left out: errors count by how they are spread over the rows, as each part of each draw is
of the same size in all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.products import by_rows
from teamslam.trust.calibration.sizes import LEAST
from teamslam.trust.calibration.slips import SLIPS, Slips

ROUNDING = 1e-6
MOST = 4.0  # times as large, in one step


@dataclass(frozen=True, eq=False)
class Scores:
    """`squares` Q (slips, 1 + draws) of `rows` rows of odometry, and how much one unit of each slip is beside what is
    `stated` (slips,)."""

    squares: Array
    stated: Array
    rows: int

    @classmethod
    def of(cls, slips: Sequence[Slips | None], now: Sequence[Noise], both: Sequence[Array]) -> "Scores":
        """Those of what is left (m, rows, 1 + draws) of errors measured and drawn, table by table."""
        score, stated, rows = np.zeros((len(SLIPS), both[0].shape[-1])), np.zeros(len(SLIPS)), 0
        for noise, slip, errors in zip(now, slips, both, strict=True):
            if slip is not None:
                squares = squares_of_rows(slip, noise, errors)
                if squares is None:
                    continue
                score += np.sum(squares, 1)
                stated += slip.beside_stated
                rows += int(slip.moving.sum())
        return cls(score, stated, rows)

    def step(self, theta: Array, chance: float) -> Array:
        """Theta (slips,) one step of Fisher's scoring on, 2 (Q - mean) / variance of the draws; half of it upwards, as
        scales move as well, and by MOST times at most; one that is next to nothing beside what is stated goes out. A
        slip that is not in comes in, all the way, where its score stands out by more than `chance` deviations of the
        draws."""
        if not self.rows:
            return theta
        drawn = self.squares[:, 1:]
        expected, spread = drawn.mean(1), drawn.std(1, ddof=1)
        beyond = self.squares[:, 0] - expected
        pace = beyond / np.maximum(spread**2, 1e-300)
        begun = np.minimum(2.0 * pace, self.rows / np.maximum(self.stated, 1e-300))
        enters = beyond > ROUNDING * expected + chance * spread
        moved = np.clip(theta + np.where(pace < 0.0, 2.0, 1.0) * pace, theta / MOST, theta * MOST)
        least = self.rows / np.maximum(self.stated, 1e-300) / MOST**2
        return np.where(theta > 0.0, np.where(moved > least, moved, 0.0), np.where(enters, begun, 0.0))


def squares_of_rows(slips: Slips, noise: Noise, errors: Array) -> Array | None:
    """l_i' B_ik l_i (slips, m, 1 + draws) of what is left of errors (m, rows, 1 + draws), measured and drawn, of rows
    under way; None where the map takes up all of a part of them."""
    squares = noise.squares(errors, slips.moving)
    if squares[:, 1:].mean(-1).min() * len(errors) < LEAST:
        return None
    even = errors * np.sqrt(squares.mean(-1, keepdims=True) / np.maximum(squares, 1e-300))
    pull = by_rows(np.swapaxes(noise.whitening, 1, 2), by_rows(noise.whitening, even))
    moved = [np.einsum("mrk,mrk->mk", pull, by_rows(unit, pull)) for unit in slips.units]
    return np.asarray(np.stack(moved) * slips.moving[:, None])
