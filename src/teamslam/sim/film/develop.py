"""What the sensor makes of the light: out of focus a little, darker towards the corners, brighter or darker as the
exposure is set, with noise, in bytes.

A pixel that holds the grey value I errs by sqrt(read^2 + shot I): electronics, and the counting of photons.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import AnyArray
from teamslam.sim.film.lens import gathered

FULL = 255.0


@dataclass(frozen=True)
class Sensor:
    """`blur_px` of the lens (a Gaussian), how much darker a corner is (`vignetting`), by how much the exposure goes up
    and down (`breathing`, with `breath_s`), and the noise [grey values]."""

    blur_px: float = 0.5
    vignetting: float = 0.3
    brightness: float = 0.95
    breathing: float = 0.15
    breath_s: float = 7.0
    read: float = 1.5
    shot: float = 0.05


def develop(points: AnyArray, sensor: Sensor, t_s: float, rng: np.random.Generator) -> AnyArray:
    """Grey values (h, w) of bytes from the light on each point (FINE h, FINE w), before the lens blurs it."""
    image = gathered(points, sensor.blur_px)
    height, width = image.shape
    y, x = np.ogrid[-1.0 : 1.0 : height * 1j, -1.0 : 1.0 : width * 1j]
    gain = sensor.brightness * (1.0 + sensor.breathing * np.sin(2.0 * np.pi * t_s / sensor.breath_s))
    grey = FULL * gain * image * (1.0 - 0.5 * sensor.vignetting * (x * x + y * y))
    noise = np.sqrt(sensor.read**2 + sensor.shot * np.maximum(grey, 0.0)) * rng.normal(size=image.shape)
    return np.asarray(np.clip(np.round(grey + noise), 0.0, FULL), np.uint8)
