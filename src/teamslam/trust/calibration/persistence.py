"""How long errors of a sensor last: their correlation in time, and what it leaves of many sightings.

    c(t) = brief exp(-t / lasting) + lasting share        of two errors a time t apart

once for sightings of one target (`same`), once for those of different targets (`across`); `lasting share` is what does
not fade within the log, a bias. Errors that hang together count as fewer: n of them with correlations c_ij say of their
mean what n / (mean of sum_j c_ij) independent ones would. So each row is weighed by 1 / sum_j c_ij (`tempering`), which
is honest for what many rows say together, such as where a landmark is, and cautious for how they differ.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import Names, Table, chi2_quantile, is_pose, robot_of

FALSE_ALARM = 1e-3  # that errors which do not hang together are said to
SHARP = 0.75  # of errors, from which on their differences are known sharply
BINS = 12
FEWEST, MOST = 100, 200_000  # pairs to speak of a correlation, and of those near by or far that are looked at
WHITE = 4  # draws of white noise that measured errors are held against


@dataclass(frozen=True)
class Curve:
    """c(t) as above: `brief`, `lasting_s` and `steady`."""

    brief: float = 0.0
    lasting_s: float = 1.0
    steady: float = 0.0

    def __call__(self, apart: Array) -> Array:
        """The correlation of errors so far apart in time [s]."""
        return np.asarray(self.brief * np.exp(-apart / self.lasting_s) + self.steady)

    @property
    def nothing(self) -> bool:
        """Whether errors do not hang together."""
        return self.brief <= 0.0 and self.steady <= 0.0


@dataclass(frozen=True)
class Persistence:
    """How errors of one part of a kind of sensor hang together: with those of the `same` target, and `across`."""

    same: Curve = Curve()
    across: Curve = Curve()

    @property
    def nothing(self) -> bool:
        """Whether errors do not hang together."""
        return self.same.nothing and self.across.nothing

    @property
    def own(self) -> Curve:
        """What errors of one target hang together by beyond what those of all targets do."""
        brief, steady = self.same.brief - self.across.brief, self.same.steady - self.across.steady
        return Curve(max(brief, 0.0), self.same.lasting_s, max(steady, 0.0))

    @property
    def sharp(self) -> bool:
        """Whether so much of what errors of one target are hangs together that how they differ is known sharply."""
        return self.own.brief + self.own.steady > SHARP

    @property
    def alone(self) -> float:
        """The share of errors that does not hang together."""
        return max(1.0 - sum(c.brief + c.steady for c in (self.own, self.across)), 0.0)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of rows of one table each, of tables of one kind one after another: places `one` and `other` (k,), near
    ones more than far ones (of n rows n log n, and MOST at most), in bins `which` (k,) of their time apart, first those
    of the same target and then the others; `apart` [s] and `count` of each bin (2 BINS,)."""

    one: IntArray
    other: IntArray
    which: IntArray
    apart: Array
    count: Array

    @classmethod
    def of(cls, tables: Sequence[Table], names: Names) -> "Pairs":
        """The pairs of tables of sightings."""
        found: list[tuple[IntArray, IntArray, Array, IntArray]] = [
            (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64))
        ]
        start = 0
        every = 1 + sum(len(table) * len(_lags(len(table))) for table in tables) // MOST
        for table in tables:
            stamps, targets = names.stamps_s(table.keys[:, 0]), targets_of(table)
            by_target, by_time = np.lexsort((stamps, targets)), np.argsort(stamps, kind="stable")
            for order, others in ((by_target, 0), (by_time, 1)):
                for lag in _lags(len(table)):
                    one, other = order[:-lag:every], order[lag::every]
                    keep = (targets[one] != targets[other]) == others
                    one, other = one[keep], other[keep]
                    apart = np.abs(stamps[other] - stamps[one])
                    found.append((one + start, other + start, apart, np.full(len(one), others)))
            start += len(table)
        one, other, apart, across = (np.concatenate(part) for part in zip(*found, strict=True))
        which = np.where(across == 0, _bins(apart, across == 0), BINS + _bins(apart, across == 1))
        order = np.argsort(which, kind="stable")
        one, other, which, apart = one[order], other[order], which[order], apart[order]
        count = np.bincount(which, minlength=2 * BINS).astype(float)
        return cls(one, other, which, np.bincount(which, apart, 2 * BINS) / np.maximum(count, 1.0), count)

    def persistence(self, sizes: Array) -> Persistence:
        """How errors hang together, from their sizes (rows, 1 + draws), first those measured: by how much more they do
        than some draws of white noise that went the same way."""
        looked_at = np.ascontiguousarray(sizes[:, : 1 + WHITE])
        counts = np.append(1.0, np.full(looked_at.shape[1] - 1, -1.0 / (looked_at.shape[1] - 1)))
        products = np.take(looked_at * counts, self.one, 0)
        products *= np.take(looked_at, self.other, 0)
        ends = np.searchsorted(self.which, np.arange(2 * BINS + 1))
        total = np.array([products[first:end].sum() for first, end in pairwise(ends.tolist())])
        mean = total / np.maximum(self.count, 1.0)
        same, across = slice(0, BINS), slice(BINS, 2 * BINS)
        return Persistence(*(curve_of(mean[part], self.apart[part], self.count[part]) for part in (same, across)))


def _bins(apart: Array, mine: BoolArray) -> IntArray:
    """Bins of about equally many of the pairs that are `mine` (k,), by their time apart."""
    if not mine.any():
        return np.zeros(len(apart), np.int64)
    edges = np.quantile(apart[mine], np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    return np.asarray(np.searchsorted(np.unique(edges), apart, "left"))


def targets_of(table: Table) -> IntArray:
    """What each row sees (m,): a landmark, or a robot, whenever it was seen."""
    target = table.keys[:, -1]
    return np.asarray(np.where(is_pose(target), -robot_of(target), target))


def curve_of(mean: Array, apart: Array, count: Array) -> Curve:
    """The correlation curve through `mean` products of `count` pairs so far `apart` in time, bin by bin, of errors
    whose size is one. None where nothing is seen that chance does not make."""
    full = count > 0
    mean, at, count = mean[full], apart[full], count[full]
    if count.sum() < FEWEST:
        return Curve()
    best, least = Curve(), float(count @ mean**2)
    for lasting in np.geomspace(max(at.min(), 1e-9) * 0.5, max(at.max() * 0.5, at.min(), 1e-9), 24):
        brief, steady = _fit(np.exp(-at / lasting), mean, count)
        left = float(count @ (mean - brief * np.exp(-at / lasting) - steady) ** 2)
        if left < least - 1e-12:
            best, least = Curve(brief, float(lasting), steady), left
    shape = best(at)
    strength = float(count @ (shape * mean)) / max(float(np.sqrt(count @ shape**2)), 1e-300)
    chance = chi2_quantile(1.0 - FALSE_ALARM, 3) * (1.0 + 1.0 / WHITE)
    return best if strength > 0.0 and strength**2 > chance else Curve()


def tempering(tables: Sequence[Table], names: Names, held: Sequence[Persistence]) -> list[Array]:
    """By how much each part of each row of tables of one kind is to be made less certain (m, r): sqrt(sum_j c_ij) over
    the rows of its table, at least 1."""
    table = np.repeat(np.arange(len(tables)), [len(t) for t in tables])
    stamps = np.concatenate([names.stamps_s(t.keys[:, 0]) for t in tables])
    _, seen = np.unique(np.concatenate([targets_of(t) for t in tables]), return_inverse=True)
    target = table * (seen.max(initial=0) + 1) + seen
    totals = [
        1.0 + _sums(stamps, target, e.same) + _sums(stamps, table, e.across) - _sums(stamps, target, e.across)
        for e in held
    ]
    return np.split(np.sqrt(np.maximum(np.stack(totals, -1), 1.0)), np.cumsum([len(t) for t in tables])[:-1])


def hanging(white: Array, table: Table, names: Names, held: Sequence[Persistence]) -> Array:
    """White noise (m, rows, draws) made to hang together as errors of each part are `held` to, of variance one as
    before: what all targets of an observer have in common, what each target has beyond it, and the rest. These take
    other draws for noise, so that they are independent of each other in each draw."""
    out, stamps, alone = white.copy(), names.stamps_s(table.keys[:, 0]), np.zeros(len(table), np.int64)
    _, target = np.unique(targets_of(table), return_inverse=True)
    for part, each in enumerate(held):
        if each.nothing:
            continue
        common, own = each.across, each.own
        brief, steady = own.brief, own.steady
        whole = max(common.brief + common.steady + brief + steady, 1.0)  # by chance more than all there is
        common_brief, common_steady, brief, steady = (
            share / whole for share in (common.brief, common.steady, brief, steady)
        )
        out[:, part] *= np.sqrt(max(1.0 - common_brief - common_steady - brief - steady, 0.0))
        levels = ((alone, common_brief, common.lasting_s, common_steady), (target, brief, own.lasting_s, steady))
        for level, (group, fading, lasting_s, staying) in enumerate(levels):
            noise = [np.roll(white[:, part], 2 * level + turn, -1) for turn in (1, 2)]
            if fading > 0.0:
                out[:, part] += np.sqrt(fading) * _fading(noise[0], stamps, group, lasting_s)
            if staying > 0.0:
                _, first = np.unique(group, return_index=True)
                out[:, part] += np.sqrt(staying) * noise[1][first][group]
    return out


def _fading(white: Array, stamps: Array, groups: IntArray, lasting_s: float) -> Array:
    """Noise (m, draws) of variance one that fades within each group: x_i = f x_(i-1) + (1 - f^2)^1/2 white_i."""
    order = np.lexsort((stamps, groups))
    alike = np.diff(groups[order], prepend=-1) == 0
    fade = np.where(alike, np.exp(-np.abs(np.diff(stamps[order], prepend=0.0)) / lasting_s), 0.0)
    out = np.empty_like(white)
    out[order] = _carried_on(fade, np.sqrt(1.0 - fade**2)[:, None] * white[order])
    return out


def _sums(stamps: Array, groups: IntArray, curve: Curve) -> Array:
    """sum over all others of one's group of c(|t_i - t_j|), (m,)."""
    if curve.nothing:
        return np.zeros(len(stamps))
    order = np.lexsort((stamps, groups))
    alike = np.diff(groups[order]) == 0
    fade = np.where(alike, np.exp(-np.abs(np.diff(stamps[order])) / curve.lasting_s), 0.0)
    near, members = np.empty(len(stamps)), np.bincount(groups)[groups]
    near[order] = _before(fade) + _before(fade[::-1])[::-1]
    return np.asarray(curve.brief * near + curve.steady * (members - 1))


def _before(fade: Array) -> Array:
    """s_i = fade_i (1 + s_(i-1)), s_0 = 0: what fades away of all before."""
    right = np.append(0.0, fade)
    return _carried_on(right, right[:, None])[:, 0]


def _carried_on(fade: Array, fresh: Array) -> Array:
    """x_i = fade_i x_(i-1) + fresh_i (m, draws); the first fades from nothing."""
    from scipy.linalg.lapack import dtbtrs

    bands = np.stack([np.ones(len(fade)), np.append(-fade[1:], 0.0)])
    return np.asarray(dtbtrs(bands, fresh, uplo="L", diag="U")[0])


def _lags(count: int) -> list[int]:
    lags, lag = [], 1
    while lag < count:
        lags.append(lag)
        lag = max(lag + 1, int(lag * 1.5))
    return lags


def _fit(fading: Array, mean: Array, count: Array) -> tuple[float, float]:
    """brief and steady, neither below zero, of weighted least squares."""
    a, b, c = float(count @ fading**2), float(count @ fading), float(count.sum())
    p, q = float(count @ (fading * mean)), float(count @ mean)
    det = a * c - b * b
    if det > 1e-9 * a * c:
        brief, steady = (c * p - b * q) / det, (a * q - b * p) / det
        if brief >= 0.0 and steady >= 0.0:
            return min(brief, 1.0), min(steady, 1.0)
    alone, level = max(p / a, 0.0), max(q / c, 0.0)
    return (min(alone, 1.0), 0.0) if p * alone > q * level else (0.0, min(level, 1.0))
