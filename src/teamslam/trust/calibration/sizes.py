"""How large errors are beside what is stated of them, and what that says of a team's deviations."""

from collections.abc import Mapping, Sequence
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
    def of(cls, squares: Array, scales: Array, rows: Array, least: float = 0.0) -> "Sizes":
        """From mean squares (k, rows, 1 + draws) of what is left of errors measured and of errors drawn, `scales` (k,
        rows) times as large as stated; `rows` (k,): how many there are. Where less than the `least` share is left of
        those drawn, errors are no smaller than they are taken to be: small residuals there are the map's doing, and by
        smaller errors it would leave less still, without end."""
        expected = np.maximum(squares[..., 1:].mean(-1), 1e-300)
        spread = squares[..., 1:].std(-1, ddof=1)
        smaller = squares[..., 0] / expected
        ratio = np.where(expected < least, np.maximum(smaller, 1.0), smaller)
        return cls(scales**2 * ratio, spread / expected, expected * rows[:, None])

    def scales(self, chance: float, common: float = 1.0) -> Array:
        """The scale of each robot's deviations, part by part (k, rows): that of all robots together, but of those that
        differ from the others their own; where nothing else is sure one, or what all else has in `common`, unless that
        is sure not to be. `chance`: how many doubts chance goes."""
        parts = range(self.ratio.shape[1])
        return np.sqrt(np.stack([self._of_part(part, chance, 2.0 * np.log(common)) for part in parts], -1))

    def _of_part(self, part: int, chance: float, common: float) -> Array:
        doubt, counts = self.doubt[:, part], self.counts[:, part]
        seen = (counts > LEAST) & (self.ratio[:, part] > 0.0)
        logs = np.log(np.where(seen, self.ratio[:, part], 1.0))
        middle = float(np.median(logs[seen])) if seen.any() else 0.0
        differs = seen & (np.abs(logs - middle) > chance * doubt)
        together = seen & ~differs
        pooled = np.array(common)
        if together.any():
            share = counts[together] / counts[together].sum()
            doubted = chance * np.sqrt(np.sum((share * doubt[together]) ** 2))
            pooled = _sure(np.log(share @ np.exp(logs[together])), doubted, common)
        return np.exp(np.where(differs, _sure(logs, chance * doubt, common), np.where(seen, pooled, common)))


def in_common(scales: Mapping[str, Sequence[Array]]) -> float:
    """By what all deviations of a log are off, from scales of what it measures, by sources: the least by which any part
    is, where two sources are, and all to one side; else one."""
    off = {source: np.concatenate(parts)[np.concatenate(parts) != 1.0] for source, parts in scales.items()}
    all_off = np.log(np.concatenate([np.zeros(0), *off.values()]))
    if sum(len(each) > 0 for each in off.values()) < 2 or abs(np.sign(all_off).sum()) < len(all_off):
        return 1.0
    return float(np.exp(all_off[np.argmin(np.abs(all_off))]))


def _sure(logs: Array, doubted: Array, common: float) -> Array:
    """Logarithms that chance, which goes as far as is `doubted`, does not make of one; else what is in `common`, or of
    one where that is as sure not to be."""
    as_others = np.where(np.abs(logs - common) <= doubted, common, 0.0)
    return np.where(np.abs(logs) > doubted, logs, as_others)
