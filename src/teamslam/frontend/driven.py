"""How far a robot drove and how far it turned, to and fro as well, by its odometry, without what is only its noise.

Noise of odometry is no way: summed over the lengths of short steps it looks like one, and a robot that stands would
seem to go on. So a speed is the length of a mean velocity (`moments`: over as many messages as foretell each step no
worse than the best number), less what the stated noise makes of such a length:

    speed^2  =  |v|^2 - k s^2,    s^2 = drift^2 / w + slip^2 speed / w       v a mean over w seconds, of k numbers

Where messages are so seldom that each is a step of its own, v is what was driven in that step.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.moments import PARTS, Velocities
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.way_noise import WayNoise
from teamslam.geometry import Array, IntArray, Pose

CHORD_S = 0.1  # apart, of which speeds are taken; messages farther apart than that are steps of their own


@dataclass(frozen=True, eq=False)
class Driven:
    """At rising `ticks` (n,), how far a robot has driven [m] and turned [rad] since the first, (n, 2)."""

    ticks: IntArray
    until: Array

    @classmethod
    def of(cls, track: Track, noise: WayNoise) -> "Driven":
        """That of odometry with two messages at least, at rising ticks."""
        chord = track.ticks // round(CHORD_S * TICKS_PER_S)
        ends = np.append(True, np.diff(chord) > 0)
        ends[-1] = True
        ticks = track.ticks[ends]
        dt = np.diff(ticks) / TICKS_PER_S
        if np.median(np.diff(track.ticks)) >= CHORD_S * TICKS_PER_S:
            there = track.poses[np.flatnonzero(ends)]
            steps = there[:-1].between(there[1:]).minus(Pose.identity(3, dt.shape))
            velocity, over = steps / dt[:, None], np.stack([dt, dt], -1)
        else:
            velocity, over = Velocities.of(track, noise).means((ticks[:-1] + ticks[1:]) // 2)
        stated = (noise.drift_m, noise.slip_m), (noise.drift_rad, noise.slip_rad)
        speeds = [_speed(velocity[:, p], over[:, k], *stated[k]) for k, p in enumerate(PARTS)]
        return cls(ticks, np.concatenate([np.zeros((1, 2)), np.cumsum(np.stack(speeds, -1) * dt[:, None], 0)]))

    def between(self, ticks: IntArray) -> Array:
        """How far it drove and turned (m - 1, 2) between instants (m,); nothing before the first message and after the
        last."""
        until = np.stack([np.interp(ticks, self.ticks, column) for column in self.until.T], -1)
        return np.asarray(np.diff(until, axis=0))


def _speed(velocity: Array, over_s: Array, drift: float, slip: float) -> Array:
    """The length of velocities (n, 3) that are means over some time (n,), without what noise adds to it."""
    numbers = np.count_nonzero(np.abs(velocity).max(0, initial=0.0) > 0.0)  # on the ground: two to move, one to turn
    squared = np.sum(velocity**2, -1)
    noise = (drift**2 + slip**2 * np.sqrt(squared)) / np.where(over_s > 0.0, over_s, np.inf)
    return np.asarray(np.sqrt(np.maximum(squared - numbers * noise, 0.0)))
