"""Ranges that are nearly depths: what a camera calls range often grows less than it should towards the image's edge.

With r the distance of a landmark, and a the angle off the sensor's axis,

    z = r (1 + k (cos a - mean of cos a)) + noise

k = 1 is depth along the axis, as right on the mean as a range is; k = 0 a range. It is fitted for each robot by least
squares that forget what is beyond some sigmas, and believed where it is far from zero by its own standard error; what
is left over tells how good the ranges are. Landmarks that stand together are told apart only then.
"""

from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, BoolArray, directions
from teamslam.model import Table

BELIEVED = 4.0  # standard errors
OUT = 2.5  # sigmas: what is beyond is forgotten
ROUNDS = 20
FEWEST = 30  # ranges that are fitted
CAREFUL = 1.2  # times what is left over, the sigma that is assumed


def straightened(table: Table, distance: Array, known: BoolArray) -> Table:
    """Ranges with bearings with what is systematic taken out of them, and the sigma of what is left; other tables as
    they are. `distance` (m,) of the landmark from the sensor by the map, where that is `known` (m,)."""
    if table.model != "range_bearing" or known.sum() < FEWEST:
        return table
    z, ahead = table.values, directions(table.dim).ray(table.values[:, 1:])[:, 0]
    bent = distance * (ahead - ahead.mean())
    k, error, left = _fitted(bent, z[:, 0] - distance, known)
    if abs(k) < BELIEVED * error:
        return table
    straight = np.concatenate([z[:, :1] / (1.0 + k * (ahead - ahead.mean()))[:, None], z[:, 1:]], 1)
    whitening = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:])).copy()
    stated = 1.0 / np.linalg.norm(whitening[:, :, 0], axis=1)
    whitening[:, :, 0] *= np.maximum(stated / (CAREFUL * left), 1.0)[:, None]
    return replace(table, values=straight, whitening=whitening)


def _fitted(x: Array, y: Array, known: BoolArray) -> tuple[float, float, float]:
    """k of y = k x, its standard error, and the sigma of what is left, from most of what is known."""
    used, k, sigma = known, 0.0, 0.0
    for _ in range(ROUNDS):
        k = float(x[used] @ y[used] / max(float(x[used] @ x[used]), 1e-300))
        sigma = 1.4826 * float(np.median(np.abs(y - k * x)[known]))
        used = known & (np.abs(y - k * x) <= OUT * sigma)
    return k, sigma / float(np.sqrt(max(float(x[used] @ x[used]), 1e-300))), sigma
