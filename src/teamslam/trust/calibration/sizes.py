"""How large errors are beside what is stated of them, and what that says of a team's deviations."""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array

LEAST = 1e-3  # of a number; what is less may be rounding


@dataclass(frozen=True, eq=False)
class Sizes:
    """Variances of errors beside those stated, by robots and parts (k, rows): their `ratio`, its relative `doubt`, and
    how many numbers it `counts` that the map does not take up."""

    ratio: Array
    doubt: Array
    counts: Array

    @classmethod
    def of(cls, squares: Array, scales: Array, rows: Array) -> "Sizes":
        """From mean squares (k, rows, 1 + draws) of what is left of errors measured and of errors drawn, `scales` (k,
        rows) times as large as stated; `rows` (k,): how many there are."""
        expected = np.maximum(squares[..., 1:].mean(-1), 1e-300)
        spread = squares[..., 1:].std(-1, ddof=1)
        return cls(scales**2 * squares[..., 0] / expected, spread / expected, expected * rows[:, None])

    def scales(self, chance: float) -> Array:
        """The scale of each robot's deviations, part by part (k, rows): that of all robots together, but of those that
        differ from the others their own, and one where nothing else is sure; `chance`: how many doubts chance goes."""
        return np.sqrt(np.stack([self._of_part(part, chance) for part in range(self.ratio.shape[1])], -1))

    def _of_part(self, part: int, chance: float) -> Array:
        doubt, counts = self.doubt[:, part], self.counts[:, part]
        seen = (counts > LEAST) & (self.ratio[:, part] > 0.0)
        logs = np.log(np.where(seen, self.ratio[:, part], 1.0))
        middle = float(np.median(logs[seen])) if seen.any() else 0.0
        differs = seen & (np.abs(logs - middle) > chance * doubt)
        together = seen & ~differs
        pooled = 1.0
        if together.any():
            share = counts[together] / counts[together].sum()
            pooled = float(share @ np.exp(logs[together]))
            if abs(np.log(pooled)) <= chance * float(np.sqrt(np.sum((share * doubt[together]) ** 2))):
                pooled = 1.0
        own = np.where(np.abs(logs) > chance * doubt, np.exp(logs), 1.0)
        return np.where(differs, own, np.where(seen, pooled, 1.0))
