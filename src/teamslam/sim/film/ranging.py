"""What a Kinect's sensor of depth makes of distances: millimetres with noise, and holes.

    noise   s(z) = 1.2 mm + 1.9 mm (z / m - 0.4)^2, alike over a few pixels, since a window of them is matched
    holes   nearer than NEAR_M and farther than FAR_M; where depth jumps within a window; and some specks anywhere

Source of the noise: Nguyen, Izadi, Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking",
3DIMPVT 2012, their axial noise of surfaces that are seen from the front to 60 degrees.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from teamslam.geometry import AnyArray, Array

NEAR_M, FAR_M = 0.5, 5.0
JUMP = 0.02  # of the depth, within a window: the projector's light is not seen from the camera there
SPECK = 3  # pixels across


@dataclass(frozen=True)
class Ranger:
    """Noise of distances, `near_m` at 0.4 m and growing by `far` [1/m] with the square of what is beyond; over how many
    pixels it is alike (`window_px`, a Gaussian's sigma); and the share of all that is lost in specks."""

    near_m: float = 1.2e-3
    far: float = 1.9e-3
    window_px: float = 1.2
    lost: float = 0.02

    def sigma(self, depth: Array) -> Array:
        """The noise of each depth [m]."""
        return np.asarray(self.near_m + self.far * (depth - 0.4) ** 2)


def ranged(depth: Array, sensor: Ranger, rng: np.random.Generator) -> AnyArray:
    """Depths (h, w) [mm], as 16 bits; 0 where nothing was measured."""
    noise = gaussian_filter(rng.normal(size=depth.shape), sensor.window_px, mode="wrap")
    found = depth + sensor.sigma(depth) * noise / _left(sensor.window_px)
    width = 2 * round(2.0 * sensor.window_px) + 1
    jumps = maximum_filter(depth, width) - minimum_filter(depth, width) > JUMP * width * depth
    specks = maximum_filter(rng.random(depth.shape) < sensor.lost / SPECK**2, SPECK)
    hole = jumps | specks | (depth < NEAR_M) | (depth > FAR_M)
    return np.asarray(np.where(hole, 0.0, np.round(1e3 * found)), np.uint16)


def _left(window_px: float) -> float:
    """What a Gaussian filter leaves of white noise of 1."""
    row = np.zeros(int(16 * window_px) + 9)
    row[len(row) // 2] = 1.0
    return float(np.sum(gaussian_filter(row, window_px) ** 2))
