"""Errors drawn from a model, and what chance makes of them: what all that is measured is held against.

Whatever is asked of the errors measured is asked of DRAWS others too, drawn from the model as it is taken to be, which
go the same way through the same fit. So its mean and its spread under the model are known without a formula for what
the map follows.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import Array
from teamslam.model.losses import SQUARED
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.rows import Linear

DRAWS = 16


def white_noise(linear: Linear) -> Array:
    """White noise (N, DRAWS) for all rows: the same every time."""
    return np.random.default_rng(0).standard_normal((len(linear.errors), DRAWS), np.float32).astype(float)


def beside_drawn(linear: Linear, now: Sequence[Noise], white: Sequence[Array]) -> Array:
    """The errors measured, and others beside them that `white` noise (m, rows, draws) makes by the noise of each table,
    (N, 1 + draws)."""
    draws = max((w.shape[-1] for w in white), default=0)
    both = np.empty((len(linear.errors), 1 + draws))
    both[:, 0] = linear.errors
    for noise, w, each in zip(now, white, linear.by_tables(both), strict=True):
        each[..., 1:] = noise.errors(w)
    return both


def felt_by(now: Sequence[Noise], left: Sequence[Array], errors: Array, linear: Linear) -> Array | None:
    """Errors (N, 1 + draws) as a fit feels them: rows weigh as those measured do by what is `left` (m, rows, 1) of
    them, and one drawn pulls by what its own loss weighs it by, w(e) e = w(measured) felt. None where no loss
    forgives."""
    if all(noise.table.loss == SQUARED for noise in now):
        return None
    felt = errors.copy()
    for noise, rest, each in zip(now, left, linear.by_tables(felt), strict=True):
        if noise.table.loss != SQUARED:
            each[..., 1:] *= (noise.weights(each[..., 1:]) / noise.weights(rest))[:, None]
    return felt


def by_chance(share: float) -> float:
    """How far from the mean of DRAWS draws, in their own deviations, another one lies with this probability."""
    from scipy.special import stdtrit

    return float(stdtrit(DRAWS - 1, 1.0 - 0.5 * share) * np.sqrt(1.0 + 1.0 / DRAWS))


def off(numbers: Array) -> Array:
    """How far the first of numbers (..., 1 + DRAWS) lies from the mean of the draws, in their own deviations; nowhere
    where there is nothing but rounding."""
    drawn = numbers[..., 1:]
    mean, spread = drawn.mean(-1), drawn.std(-1, ddof=1)
    told = spread > 1e-9 * np.abs(mean)
    return np.where(told, (numbers[..., 0] - mean) / np.where(told, spread, 1.0), 0.0)
