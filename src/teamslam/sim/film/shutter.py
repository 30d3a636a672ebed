"""When each point of each pixel is exposed.

A pixel is the mean of 3 x 3 points in it, and its exposure that of 9 instants: each point has one of them, by the magic
square, whose rows and columns all have the same mean. Which has which goes round from pixel to pixel (`render`), so
that along an edge no point's place hangs together with its time, and a moving edge is smeared as its motion has it,
about where it is in the middle of the exposure. A rolling shutter exposes one line after the other.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array

FINE = 3
MAGIC = np.array([[2, 7, 6], [9, 5, 1], [4, 3, 8]])


@dataclass(frozen=True)
class Shutter:
    """How long each line is exposed, and how much later than the one above (0: all at once) [s]."""

    exposure_s: float = 0.006
    line_s: float = 15e-6

    def __post_init__(self) -> None:
        if not (0.0 <= self.exposure_s < np.inf and 0.0 <= self.line_s < np.inf):
            raise InputError("exposure and line time are 0 or more [s]", field="shutter")

    def times(self, middle_s: float, lines: int) -> Array:
        """When each point is exposed (3, 3, lines) [s], around the middle of the middle line's exposure."""
        of_line = (np.arange(lines) - 0.5 * (lines - 1)) * self.line_s
        within = (MAGIC - 5.0) / MAGIC.size * self.exposure_s
        return middle_s + within[..., None] + of_line
