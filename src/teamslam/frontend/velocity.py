"""Velocities held from stamp to stamp, integrated along arcs into increments between chosen instants, with covariance.

While a command (v, w) holds for dt the robot follows an arc of a circle (paper, eq. 15, corrected and free of the
division by w):

    s = v dt sinc(w dt / 2),   dx = s cos(th + w dt / 2),   dy = s sin(th + w dt / 2),   dth = w dt

The true velocity is the command plus white noise, forward, sideways and in turning, of densities

    q_forward  = forward^2  + forward_per_metre^2 |v|
    q_sideways = sideways^2 + sideways_per_metre^2 |v|
    q_turn     = turn^2     + turn_per_radian^2 |w| + turn_per_metre^2 |v|

so an increment's covariance is  int G(s) diag(q) G(s)' ds,  G(s) = [R(th_s), J (p_end - p_s); 0 0 1]: a turn at s
swings the rest of the way about p_s. Increments are independent of each other, wherever a way is cut. Each arc is
integrated by two-point Gauss quadrature (exact for straight pieces).
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray

_GAUSS = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))


@dataclass(frozen=True)
class VelocityNoise:
    """Square roots of the noise densities of held velocities.

    `forward`, `sideways` [m/sqrt(s)] and `turn` [rad/sqrt(s)] grow with time, whether the robot moves or not;
    `..._per_metre` [m/sqrt(m), rad/sqrt(m)] and `turn_per_radian` [rad/sqrt(rad)] are slip: they grow with the way.
    """

    forward: float
    sideways: float
    turn: float
    forward_per_metre: float = 0.0
    sideways_per_metre: float = 0.0
    turn_per_metre: float = 0.0
    turn_per_radian: float = 0.0

    def densities(self, v: Array, w: Array) -> Array:
        """Noise densities (..., 3) of x, y, heading in the body at velocities v [m/s] and w [rad/s]."""
        v, w = np.abs(v), np.abs(w)
        return np.stack(
            [
                self.forward**2 + self.forward_per_metre**2 * v,
                self.sideways**2 + self.sideways_per_metre**2 * v,
                self.turn**2 + self.turn_per_metre**2 * v + self.turn_per_radian**2 * w,
            ],
            -1,
        )


def integrate(
    stamps: IntArray, velocities: Array, at: IntArray, noise: VelocityNoise, *, tick_s: float = 1e-6
) -> tuple[Array, Array]:
    """Increments x, y, heading (k - 1, 3) between the instants `at` (k,) and their covariances (k - 1, 3, 3).

    `velocities` (n, 2) are v [m/s] and w [rad/s], each held from its stamp to the next (the last one for ever); stamps
    rise, and `at` rises strictly and begins at or after the first stamp. Law: increments compose to the increment over
    the whole.
    """
    if len(at) < 2:
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    inner = stamps[(stamps > at[0]) & (stamps < at[-1])]
    breaks = np.unique(np.concatenate([at, inner]))
    v, w = velocities[np.searchsorted(stamps, breaks[:-1], "right") - 1].T
    dt = np.diff(breaks) * tick_s
    first = np.searchsorted(breaks, at)  # the break at which each instant stands
    interval = np.repeat(np.arange(len(at) - 1), np.diff(first))
    headings = _running(w * dt)
    start = headings[:-1] - headings[first[interval]]  # heading at each arc's start, seen from its interval's start
    xy = _arc(v, w, dt, start)
    path = np.stack([_running(xy[:, 0]), _running(xy[:, 1])], -1)
    # `path` adds the arcs as each interval sees them, so differences are meaningful within one interval only.
    ends = path[first[1:]]
    increments = np.concatenate([ends - path[first[:-1]], np.diff(headings[first])[:, None]], -1)
    densities = noise.densities(v, w) * (0.5 * dt)[:, None]
    covariances = np.zeros((len(at) - 1, 3, 3))
    for fraction in _GAUSS:
        lever = ends[interval] - path[:-1] - _arc(v, w, fraction * dt, start)
        c, s = np.cos(start + fraction * w * dt), np.sin(start + fraction * w * dt)
        zero, one = np.zeros_like(c), np.ones_like(c)
        G = np.stack([np.stack([c, -s, -lever[:, 1]], -1), np.stack([s, c, lever[:, 0]], -1),
                      np.stack([zero, zero, one], -1)], -2)  # fmt: skip
        covariances += np.add.reduceat((G * densities[:, None, :]) @ np.swapaxes(G, -1, -2), first[:-1])
    return increments, covariances


def _arc(v: Array, w: Array, dt: Array, heading: Array) -> Array:
    """Displacement (n, 2) over arcs that start at `heading`."""
    half = 0.5 * w * dt
    chord = v * dt * np.sinc(half / np.pi)
    return np.stack([chord * np.cos(heading + half), chord * np.sin(heading + half)], -1)


def _running(steps: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(steps)])
