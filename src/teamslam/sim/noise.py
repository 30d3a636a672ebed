"""Noise in each sensor's own coordinates: z = h (+) n, such that z (-) h = n exactly.

So a simulated residual at the truth is the drawn n itself, and what the estimator believes of the noise is true. Most
measurements are plain numbers and add; poses turn by the exponential; directions of space turn on the sphere.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array
from teamslam.model import MODELS


@dataclass(frozen=True)
class Noise:
    """One row of NOISES: how many lengths, then angles, a residual has in the plane and in space, and h (+) n."""

    lengths: tuple[int, int]
    angles: tuple[int, int]
    plus: Callable[[Array, Array, int], Array]


def sigmas(model: str, dim: int, sigma_m: float, sigma_rad: float) -> Array:
    """The standard deviation (rows,) of each number in a residual; InputError for a sensor not in NOISES."""
    if model not in NOISES:
        raise InputError(
            f"no noise is known for the sensor '{model}'; give its standard deviations as `sigmas`", field="sigmas"
        )
    row = NOISES[model]
    return np.concatenate([np.full(row.lengths[dim - 2], sigma_m), np.full(row.angles[dim - 2], sigma_rad)])


def plus(model: str, h: Array, n: Array, dim: int) -> Array:
    """h (+) n: measurements (m, size) from predictions h (m, size) and noise n (m, rows).

    A sensor that is not in NOISES adds; InputError where its residual is not such that this gives z (-) h = n.
    """
    if model in NOISES:
        return NOISES[model].plus(h, n, dim)
    z = h + n if h.shape == n.shape else h
    if not np.allclose(MODELS[model].minus(z, h, dim), n, atol=1e-9):
        raise InputError(f"noise does not simply add for the sensor '{model}'; put a row for it into NOISES")
    return z


def _add_range(h: Array, n: Array, dim: int) -> Array:
    # No instrument reports a distance below zero: very close by, the noise counts outwards.
    return np.where(h + n > 0.0, h + n, h + np.abs(n))


def _range_then_direction(h: Array, n: Array, dim: int) -> Array:
    return np.concatenate([_add_range(h[:, :1], n[:, :1], dim), MODELS["bearing"].plus(h[:, 1:], n[:, 1:], dim)], -1)


NOISES: dict[str, Noise] = {
    "relative_pose": Noise((2, 3), (1, 3), MODELS["pose"].plus),
    "point": Noise((2, 3), (0, 0), MODELS["point"].plus),
    "range": Noise((1, 1), (0, 0), _add_range),
    "bearing": Noise((0, 0), (1, 2), MODELS["bearing"].plus),
    "range_bearing": Noise((1, 1), (1, 2), _range_then_direction),
    "position": Noise((2, 3), (0, 0), MODELS["point"].plus),
    "pose": Noise((2, 3), (1, 3), MODELS["pose"].plus),
    "corners": Noise((0, 0), (0, 8), MODELS["corners"].plus),
}
