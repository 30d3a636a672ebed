"""A robot's clock beside that of the team, which is the first robot's.

    s = m + (1 + d) (t - (m - o))          a moment that the team calls t is stamped s

o is how much later stamps are in the middle m of the robot's recording, d by how much more that grows in a second.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S
from teamslam.geometry import IntArray


@dataclass(frozen=True)
class Clock:
    """`middle` [ticks] by the robot's own stamps, `offset_s` there, and the `drift` (1e-6: a microsecond a second)."""

    middle: int = 0
    offset_s: float = 0.0
    drift: float = 0.0

    def own(self, ticks: IntArray) -> IntArray:
        """The robot's stamps of moments by the team's clock. Law: team(own(t)) = t, to a tick."""
        since = ticks - self.middle + self.offset_s * TICKS_PER_S
        return np.asarray(self.middle + np.round((1.0 + self.drift) * since).astype(np.int64))

    def team(self, ticks: IntArray) -> IntArray:
        """Moments by the team's clock of the robot's stamps."""
        since = (ticks - self.middle) / (1.0 + self.drift) - self.offset_s * TICKS_PER_S
        return np.asarray(self.middle + np.round(since).astype(np.int64))
