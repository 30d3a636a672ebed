"""How a robot moved in the moments after a stamp, by odometry: X(t)^-1 X(t + d) = Exp(d v), v its velocity in the body.

How late a camera is, is told by what v does to its rows. Noise of v is taken for motion there: it makes a latency look
known that is not, and drags it to where, between two messages, interpolation averages most noise. So v is a mean over
several steps of odometry, as many as foretell each step no worse than the best number does; and over a whole number of
messages to each side, from wherever t is between two of them, so that noise that is alike from message to message drags
nowhere.

    u_k    =  log(X_k^-1 X_k+1) / dt_k
    v(p)   =  mean of u, by dt, from p - m to p + m           p = k + (t - t_k) / dt_k
    m      :  the widest, from WINDOW_S to each side on, of which  sum_k dt_k |u_k - mean of u about k but for u_k|^2
              is not clearly more than the least: too wide tells less of a latency and says so, too narrow lies
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.way_noise import WayNoise, jumps
from teamslam.geometry import Array, BoolArray, IntArray, Pose

WINDOW_S, WIDEST_S = 0.05, 2.0  # to each side
LONGEST_S = 1.0  # between two messages, beyond which odometry is missing
TRIED = 10  # widths
FEWEST = 10  # steps by which widths are compared
PARTS = (slice(0, 3), slice(3, 6))  # moving, turning: each has a width of its own


def moved(track: Track, ticks: IntArray, over_s: Array, noise: WayNoise) -> Pose:
    """How a robot moved (m, k) in the moments `over_s` (m, k) after `ticks` (m,), X(t)^-1 X(t + d), as fast as its
    odometry says it was; not at all where that is missing. Steps that jumped count for nothing.

    Law: exact where velocities in the body do not change.
    """
    if len(track) < 2:
        return Pose.identity(3, over_s.shape)
    return Pose.from_tangent(over_s[..., None] * _velocities(track, noise).at(ticks)[:, None], 3)


def unsure(track: Track, ticks: IntArray, noise: WayNoise) -> Array:
    """By how much velocities that `moved` takes for motion err (m, 6) [m/s, rad/s], one sigma of each number by itself,
    as the stated noise of odometry has it; 0 for what never moves, and where odometry is missing.

    Law: the root of (drift^2 + slip^2 speed) / w of a mean over w seconds.
    """
    if len(track) < 2:
        return np.zeros((len(ticks), 6))
    velocities = _velocities(track, noise)
    velocity, over = velocities.means(ticks)
    moves: BoolArray = np.asarray(velocities.driven.any(0))
    out = np.zeros((len(ticks), 6))
    for n, (part, drift, slip) in enumerate(zip(PARTS, (noise.drift_m, noise.drift_rad), (noise.slip_m, noise.slip_rad),
                                                strict=True)):  # fmt: skip
        speed = np.linalg.norm(velocity[:, part], axis=1)
        variance = (drift**2 + slip**2 * speed) / np.where(over[:, n] > 0.0, over[:, n], np.inf)
        out[:, part] = np.sqrt(variance)[:, None] * moves[part]
    return out


@dataclass(frozen=True, eq=False)
class Velocities:
    """Of messages at rising `ticks` (n,): what was driven until each (n, 6) and in what time (n,) [s], jumps and gaps
    left out; the steps that are `gaps`; and over how many messages to each side moving and turning are averaged."""

    ticks: IntArray
    driven: Array
    time: Array
    gaps: IntArray
    widths: tuple[int, int]

    @classmethod
    def of(cls, track: Track, noise: WayNoise) -> "Velocities":
        """Those of odometry with two messages at least."""
        order = np.argsort(track.ticks, kind="stable")
        track = track.select(order[np.append(True, np.diff(track.ticks[order]) > 0)])
        dt = np.diff(track.ticks) / TICKS_PER_S
        steps = track.poses[:-1].between(track.poses[1:]).minus(Pose.identity(3, dt.shape))
        weight = np.where(jumps(track, noise) | (dt > LONGEST_S), 0.0, dt)
        steps = np.where(weight[:, None] > 0.0, steps, 0.0)
        moving, turning = (_width(steps[:, part], weight) for part in PARTS)
        gaps = np.flatnonzero(dt > LONGEST_S)
        return cls(track.ticks, _until(steps), _until(weight), gaps, (moving, turning))

    def at(self, ticks: IntArray) -> Array:
        """Velocities in the body (m, 6) [m/s, rad/s]; zero where odometry is missing."""
        return self.means(ticks)[0]

    def means(self, ticks: IntArray) -> tuple[Array, Array]:
        """Velocities, as `at` gives them, and over how long moving and turning are averaged (m, 2) [s]."""
        out, over = np.zeros((len(ticks), 6)), np.zeros((len(ticks), 2))
        if len(self.ticks) < 2:
            return out, over
        k = np.clip(np.searchsorted(self.ticks, ticks, "right") - 1, 0, len(self.ticks) - 2)
        p = k + (ticks - self.ticks[k]) / (self.ticks[k + 1] - self.ticks[k])
        bounds = np.concatenate([[-1], self.gaps, [len(self.ticks) - 1]])
        after = np.searchsorted(bounds, k)
        first, last = bounds[after - 1] + 1, bounds[after]
        for n, (part, width) in enumerate(zip(PARTS, self.widths, strict=True)):
            ends = np.maximum(p - width, first), np.minimum(p + width, last)
            way, time = (_between(sums, *ends) for sums in (self.driven[:, part], self.time[:, None]))
            out[:, part] = way / np.where(time > 0.0, time, np.inf)
            over[:, n] = time[:, 0]
        held = (ticks >= self.ticks[0]) & (ticks <= self.ticks[-1]) & ~self._missing(k)
        return np.where(held[:, None], out, 0.0), over

    def _missing(self, steps: IntArray) -> BoolArray:
        return np.isin(steps, self.gaps)


@lru_cache(maxsize=32)
def _velocities(track: Track, noise: WayNoise) -> Velocities:
    return Velocities.of(track, noise)


def _width(steps: Array, weight: Array) -> int:
    """The number of messages to each side over which what was driven in each step (n, 3), with its time (n,), is
    averaged: the widest by which each step is foretold no worse, give or take a standard error, than by the best."""
    usual = float(np.median(weight[weight > 0.0])) if (weight > 0.0).any() else LONGEST_S
    least = max(1, int(np.ceil(WINDOW_S / usual - 1e-9)))
    most = min(int(WIDEST_S / usual), (len(weight) - FEWEST) // 2)
    if most <= least:
        return least
    tried = np.unique(np.round(np.geomspace(least, most, TRIED)).astype(np.int64))
    k = np.arange(most, len(weight) - most)
    k = k[weight[k] > 0.0]
    if not len(k):
        return least  # all of it jumped, or none was driven in time
    driven, time = _until(steps), _until(weight)
    found = steps[k] / weight[k, None]
    missed = []
    for m in tried.tolist():
        others = time[k + m + 1] - time[k - m] - weight[k]
        mean = (driven[k + m + 1] - driven[k - m] - steps[k]) / np.where(others > 0.0, others, np.inf)[:, None]
        missed.append(weight[k] * np.sum((found - mean) ** 2, 1))
    more = np.array(missed) - missed[int(np.argmin(np.sum(missed, 1)))]
    return int(tried[np.flatnonzero(more.sum(1) <= more.std(1) * np.sqrt(len(k)))[-1]])


def _until(each: Array) -> Array:
    """Sums (n + 1, ...) of what comes before each of n steps."""
    return np.concatenate([np.zeros_like(each[:1]), np.cumsum(each, 0)])


def _between(sums: Array, start: Array, stop: Array) -> Array:
    """What sums (n, k) grow by from places to others (m,), straight between whole ones."""
    first, last = (_straight(sums, at) for at in (start, stop))
    return np.asarray(last - first)


def _straight(sums: Array, at: Array) -> Array:
    k = np.clip(np.floor(at).astype(np.int64), 0, len(sums) - 2)
    return np.asarray(sums[k] + (at - k)[:, None] * (sums[k + 1] - sums[k]))
