"""When each point of each pixel is exposed.

A pixel has 3 x 3 points, and its exposure three thirds: each point stands for one third, by a square in which each line
and each column has each third once, so that along an edge no point's place hangs together with its time, and a moving
edge is smeared as its motion has it, about where it is in the middle of the exposure. A rolling shutter exposes one
line after the other.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array

FINE = 3
THIRDS = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])


@dataclass(frozen=True)
class Shutter:
    """How long each line is exposed, and how much later than the one above (0: all at once) [s]."""

    exposure_s: float = 0.006
    line_s: float = 15e-6

    def __post_init__(self) -> None:
        if not (0.0 <= self.exposure_s < np.inf and 0.0 <= self.line_s < np.inf):
            raise InputError("exposure and line time are 0 or more [s]", field="shutter")

    def times(self, middle_s: float, lines: int) -> Array:
        """The middle of each third of each line's exposure (3, lines) [s], around that of the middle line's."""
        of_line = (np.arange(lines) - 0.5 * (lines - 1)) * self.line_s
        thirds = (np.arange(FINE) - 1.0) / FINE * self.exposure_s
        return middle_s + thirds[:, None] + of_line
