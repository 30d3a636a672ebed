"""Where a sighting is more likely wrong than right: the gate on its squared residual, from one probability.

A sighting is wrong with probability p, and then anywhere that its sensor reports; else it is off by its noise:

    (1 - p) N(e; 0, S)  against  p / V          right if  s = e'S^-1 e < c^2 = 2 log[(1 - p) V / (p sqrt|2 pi S|)]

V, the volume of what the sensor reports, is read off its own sightings. So the gate widens with what a sensor can tell
apart, and hardly depends on p, which therefore can come from the data: it is the share that was found wrong. Noise that
is larger than stated would fall through any gate, so its size comes from the residuals too: their median, where that
share is wrong, should be the chi-square distribution's.

Source: Hartley, Zisserman, "Multiple View Geometry" (2004), sec. 4.7.1, for thresholds from chi-square; the uniform
alternative is that of MLESAC (Torr, Zisserman, CVIU 2000).
"""

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Table, chi2_quantile

LEAST = 9.0  # of a gate: three sigmas; sensors that tell little apart reject nothing nearer
PRIOR = 0.05  # of a sighting to be wrong, before anything is known
WEIGHT = 20.0  # sightings that this counts as
FEWEST = 12  # rows of a sensor whose noise is estimated
LARGEST = 25.0  # of the noise's variance over the stated one


def gates(table: Table, probability: float, noise: float = 1.0) -> Array:
    """c^2 (m,) of the rows of one sensor, for squared residuals by the stated noise, which is larger by `noise` in
    variance."""
    numbers = np.maximum(table.ranks, 1)
    volume = _volume(table) - numbers * np.log(np.sqrt(2.0 * np.pi * noise))
    odds = np.log((1.0 - probability) / probability)
    return np.asarray(noise * np.maximum(2.0 * (odds + volume), LEAST))


def _volume(table: Table) -> Array:
    """log V / sqrt|S| (m,): how many sigmas of room a sensor's sightings take, in all its numbers together."""
    if len(table) < 2:
        return np.zeros(len(table))
    # Differences of random pairs reach as far as the sightings do.
    apart = table.row.minus(table.values, np.roll(table.values, len(table) // 2 + 1, 0), table.dim)
    room = np.abs((table.whitening @ apart[..., None])[..., 0]).max(0)
    each = np.log(np.maximum(room, 1.0))
    measured = np.broadcast_to((table.whitening != 0.0).any(-1), (len(table), len(each)))
    return np.asarray((measured * each).sum(-1))


def share_wrong(rejected: int, of: int) -> float:
    """The probability that a sighting is wrong, once so many were rejected: the mean under a weak prior."""
    return float(np.clip((rejected + PRIOR * WEIGHT) / (of + WEIGHT), 1e-4, 0.9))


def noise_of(squared: Array, numbers: IntArray, wrong: float) -> float:
    """By how much larger the noise of right sightings is than stated, in variance, from the squared residuals (m,) of
    a sensor of whose sightings a share is `wrong`; between 1 and LARGEST."""
    if len(squared) < FEWEST:
        return 1.0
    usual = squared / chi2_quantile(0.5, np.maximum(numbers, 1))
    return float(np.clip(np.quantile(usual, 0.5 * (1.0 - wrong)), 1.0, LARGEST))
