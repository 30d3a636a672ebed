"""The clocks of a film: what each recording's stamps are off by, the same for everybody who did not plant it."""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.clock import Clock
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.geometry import Array, IntArray

OFFSETS_S, DRIFT, LATENCIES_S = (0.01, 0.5), 50e-6, (0.01, 0.12)


@dataclass(frozen=True)
class Clocks:
    """What is planted: of each robot how late its clock is in the middle of the film, and its drift, beside the first
    robot's; how late its camera stamps images; and how late the clock of the motion capture is."""

    offset_s: tuple[float, ...] = ()
    drift: tuple[float, ...] = ()
    latency_s: tuple[float, ...] = ()
    capture_s: float = 0.0

    def of(self, robot: int, middle: int) -> Clock:
        """The clock of a robot, from 0; `middle` is that of the film [ticks]."""
        offset = self.offset_s[robot] if self.offset_s else 0.0
        return Clock(middle + round(offset * TICKS_PER_S), offset, self.drift[robot] if self.drift else 0.0)

    def latency(self, robot: int) -> float:
        """How late the camera of a robot stamps its images [s]."""
        return self.latency_s[robot] if self.latency_s else 0.0


def drawn_clocks(seed: int, robots: int) -> Clocks:
    """Offsets of 10 to 500 ms, drifts of 50 ppm, latencies of 10 to 120 ms; the first robot's clock is the team's."""
    rng = np.random.default_rng([seed, 3])
    signs = rng.choice([-1.0, 1.0], (2, robots))
    offsets = signs[0] * rng.uniform(*OFFSETS_S, robots)
    first = np.arange(robots) == 0
    return Clocks(
        _numbers(np.where(first, 0.0, offsets)),
        _numbers(np.where(first, 0.0, signs[1] * DRIFT)),
        _numbers(rng.uniform(*LATENCIES_S, robots)),
        round(float(rng.uniform(-0.1, 0.1)), 4),
    )


def stamped(track: Track, clock: Clock) -> Track:
    """A track by another clock."""
    return Track(clock.own(track.ticks), track.poses, track.parent, track.child)


def _numbers(values: Array | IntArray) -> tuple[float, ...]:
    return tuple(round(float(value), 6) for value in values)
