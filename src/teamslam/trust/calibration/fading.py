"""How errors fade of which nearly all hang together: looked at once more, as their differences tell it best.

`Pairs.persistence` holds what a map leaves of errors against white noise, and so sees them fade sooner than they do: a
map follows what lasts. Where little of them does not hang together, what successive sightings say of how they differ is
sharp (see `successive`), and hangs on it. So errors that hang together as is held by now are drawn and go through the
fit that weighs rows so; the curve is moved by how those measured differ from them, until it settles:

    c(t)  <-  c(t) + measured - drawn

each of these by the mean product of pairs, or by one less half the mean square of how they differ, whichever chance
moves less: of errors that hang together closely the latter does not hang on how large they happened to be.
"""

from collections.abc import Callable

import numpy as np

from teamslam.geometry import Array
from teamslam.trust.calibration.persistence import BINS, Curve, Pairs, Persistence

STAYS = 3.0  # deviations of what chance makes, by which a share is said to stay
APART = 2.0**0.5  # and by which one is said not to hang together: the better model by Akaike's criterion
LEAST = 1e-3  # of a correlation: less is not told
SETTLED = 0.02  # of a share; of how long errors last 2.5 times as much


def settles(one: Persistence, other: Persistence) -> bool:
    """Whether errors of one target hang together nearly the same."""
    a, b = one.own, other.own
    slower = abs(float(np.log(a.lasting_s / b.lasting_s)))
    return max(abs(a.brief - b.brief), abs(a.steady - b.steady), slower / 2.5) < SETTLED


def refined(pairs: Pairs, sizes: Array, drawn: Persistence) -> Persistence:
    """How errors of one target hang together, from their sizes (rows, 1 + draws) in the deviations that they have:
    first those measured, then some that were `drawn` to hang together so. Across targets as before."""
    told, apart, chance = _told(pairs, np.ascontiguousarray(sizes.T), drawn)
    common = drawn.across
    own = _simplest(apart, told - common(apart), chance, 1.0 - common.brief - common.steady)
    return Persistence(Curve(own.brief + common.brief, own.lasting_s, own.steady + common.steady), common)


def _told(pairs: Pairs, sizes: Array, drawn: Persistence) -> tuple[Array, Array, Array]:
    """Correlations (bins,) of errors of one target so far `apart`, and by how much chance moved those of the draws
    (bins, draws), such that squares add up to variances."""
    near = pairs.which < BINS
    one, other, which = pairs.one[near], pairs.other[near], pairs.which[near]
    count = np.maximum(pairs.count[:BINS], 1.0)
    products = np.stack([np.bincount(which, each[one] * each[other], BINS) for each in sizes], -1) / count[:, None]
    halves = np.stack([np.bincount(which, (each[one] - each[other]) ** 2, BINS) for each in sizes], -1) / count[:, None]
    surer = halves[:, 1:].std(-1) < 2.0 * products[:, 1:].std(-1)
    found = np.where(surer[:, None], 1.0 - 0.5 * halves, products)[pairs.count[:BINS] > 0]
    apart, mean, draws = pairs.apart[:BINS][pairs.count[:BINS] > 0], found[:, 1:].mean(-1), found.shape[1] - 1
    chance = (found[:, 1:] - mean[:, None]) * np.sqrt((1.0 + 1.0 / draws) / (draws - 1))
    return found[:, 0] - mean + drawn.own(apart) + drawn.across(apart), apart, chance


def _simplest(apart: Array, told: Array, chance: Array, most: float) -> Curve:
    """The curve that fits best, of shares that add up to `most` at most, without what is not sure: that some stays, and
    that some does not hang together at all."""
    sure = np.maximum(np.sqrt(np.sum(chance**2, -1)), LEAST) ** -2
    best = _best(apart, told, sure, lambda fading: _both(fading, told, sure, most))
    if best.steady > 0.0:
        shapes = [np.exp(-apart / best.lasting_s)] * (best.brief > 0.0) + [np.ones_like(apart)]
        if best.steady > STAYS * _doubt(np.stack([shapes[-1], *shapes[:-1]], -1), sure, chance):
            return best
    best = _best(apart, told, sure, lambda fading: (_share(fading, told, sure, most), 0.0))
    fading = np.exp(-apart / best.lasting_s)
    if most - best.brief < APART * _doubt(np.stack([fading, apart * fading], -1), sure, chance):
        return _best(apart, told, sure, lambda fading: (most, 0.0))
    return best


def _doubt(shapes: Array, sure: Array, chance: Array) -> float:
    """The deviation by chance of how much of the first of some shapes (bins, k) there is."""
    root = np.sqrt(sure)
    takes = np.linalg.pinv(root[:, None] * shapes)[0] * root
    return float(np.sqrt(np.sum((takes @ chance) ** 2)))


def _best(apart: Array, told: Array, sure: Array, shares: Callable[[Array], tuple[float, float]]) -> Curve:
    """The curve of least squares, whose `shares`, brief and steady, follow from how it fades."""
    best, least = Curve(), float(sure @ told**2)
    low, high = max(apart.min(), 1e-9) * 0.5, max(apart.max() * 0.5, apart.min(), 1e-9)
    for _ in range(3):  # each closer
        tried = np.geomspace(low, high, 16)
        for lasting in tried.tolist():
            fading = np.exp(-apart / lasting)
            brief, steady = shares(fading)
            left = float(sure @ (told - brief * fading - steady) ** 2)
            if left < least - 1e-12:
                best, least = Curve(brief, lasting, steady), left
        if best.brief <= 0.0:
            break
        step = tried[1] / tried[0]
        low, high = best.lasting_s / step, min(best.lasting_s * step, high)
    return best


def _both(fading: Array, told: Array, sure: Array, most: float) -> tuple[float, float]:
    """brief and steady, neither below zero, nor `most` exceeded together, of weighted least squares."""
    weighed = np.sqrt(sure)
    shapes = np.stack([fading, np.ones_like(fading)], -1)
    brief, steady = np.linalg.lstsq(weighed[:, None] * shapes, weighed * told, rcond=None)[0].tolist()
    if brief < 0.0:
        return 0.0, _share(np.ones_like(fading), told, sure, most)
    if steady < 0.0:
        return _share(fading, told, sure, most), 0.0
    if brief + steady > most:
        steady = _share(1.0 - fading, told - most * fading, sure, most)
        brief = most - steady
    return brief, steady


def _share(shape: Array, told: Array, sure: Array, most: float) -> float:
    """How much of a shape there is, none to `most`, by weighted least squares."""
    return min(max(float(sure @ (shape * told)) / max(float(sure @ shape**2), 1e-300), 0.0), most)
