"""A robot's way as rows: odometry between keyframes with its jumps taken out, and a motion model where there is none.

Odometry that was optimised on the way (visual-inertial, or with loops closed) jumps: between two messages it is off by
far more than the robot can move. A step is a jump where its speed exceeds the stated fastest, and a step that jumped
tells nothing: the robot is taken to have gone on as the motion model says, with its uncertainty.

    between keyframes:   X_a^-1 X_b, steps composed; covariance grows with time, with the way and with the turns that
                         were driven, and a wrong turn carries off what was driven after it
    between messages:    a straight line from one to the next, and how far the way may be beside it: by its differences
    motion model:        stands still, give or take speed * dt and turn * dt (a camera carried by hand)
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.driven import CHORD_S, Driven
from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.way_noise import WayNoise, jumps
from teamslam.geometry import Array, IntArray, Pose, so3


@dataclass(frozen=True, eq=False)
class Steps:
    """Relative poses (n - 1,) between keyframes with covariances (n - 1, 6, 6), and the instants [ticks] at which
    odometry jumped or was missing."""

    poses: Pose
    covariances: Array
    jumps: IntArray
    missing: int


def standing(dt_s: Array, noise: WayNoise) -> tuple[Pose, Array]:
    """The motion model: relative poses (n,) over times (n,) [s], and their variances (n, 6)."""
    spread = np.zeros((len(dt_s), 6))
    spread[:, :3] = (np.maximum(noise.speed_m_s * dt_s, 1e-3) ** 2)[:, None]
    spread[:, 3:] = (np.maximum(noise.turn_rad_s * dt_s, 1e-3) ** 2)[:, None]
    return Pose.identity(3, (len(dt_s),)), spread


def steps_between(track: Track, keyframes: IntArray, noise: WayNoise, longest_s: float = 1.0) -> Steps:
    """The way between keyframes [ticks] by odometry, and by the motion model where that jumped or is missing."""
    dt = np.diff(keyframes) / TICKS_PER_S
    still, spread = standing(dt, noise)
    none = np.zeros(0, np.int64)
    if len(track) < 2:
        return Steps(still, diagonal(spread), none, len(dt))
    order = np.argsort(track.ticks, kind="stable")
    order = order[np.append(True, np.diff(track.ticks[order]) > 0)]
    track = track.select(order)
    jumped = jumps(track, noise)
    poses, held = interpolate(track.ticks, track.poses, keyframes, round(longest_s * TICKS_PER_S))
    steps = poses[:-1].between(poses[1:])
    first, last = np.searchsorted(track.ticks, keyframes[:-1], "right") - 1, np.searchsorted(track.ticks, keyframes[1:])
    count = np.concatenate([[0], np.cumsum(jumped)])
    clean = count[np.clip(last, 0, len(jumped))] - count[np.clip(first, 0, len(jumped))] == 0
    good = held[:-1] & held[1:] & clean
    covariances = diagonal(spread)
    beside = beside_the_line(track, keyframes) ** 2
    driven = driven_noise(track, keyframes, noise) + diagonal(beside[:-1] + beside[1:])
    each = good[:, None, None]
    covariances = np.where(each, driven, covariances)
    steps = Pose(np.where(each, steps.rotation, still.rotation), np.where(good[:, None], steps.translation, 0.0))
    return Steps(steps, covariances, track.ticks[1:][jumped], int(np.count_nonzero(~(held[:-1] & held[1:]))))


def driven_noise(track: Track, keyframes: IntArray, noise: WayNoise) -> Array:
    """The covariances (n - 1, 6, 6) of the steps between keyframes [ticks] as the robot drove, to and fro and round
    bends. `track` has messages at rising ticks.

    Over a chord k, of length l and turn a, the noise is alike in all directions, and of what is driven after it, d_k to
    the end (in the frame a step is measured in), a turn carries off the end:

        s_k = drift_m^2 dt + slip_m^2 l,   r_k = drift_rad^2 dt + slip_rad^2 a
        place, place:  sum s_k + r_k (|d_k|^2 - d_k d_k')      turn, turn:  sum r_k      place, turn:  -sum r_k [d_k] R

    Law: covariances of steps compose, through a keyframe or past it.
    """
    if len(keyframes) < 2:
        return np.zeros((0, 6, 6))
    inside = track.ticks[(track.ticks > keyframes[0]) & (track.ticks < keyframes[-1])]
    chord = inside // round(CHORD_S * TICKS_PER_S)
    at = np.union1d(keyframes, inside[np.append(True, np.diff(chord) > 0)] if len(inside) else inside)
    poses, _ = interpolate(track.ticks, track.poses, at, int(track.ticks[-1] - track.ticks[0]))
    dt, (way, turn) = np.diff(at) / TICKS_PER_S, Driven.of(track, noise).between(at).T
    s = noise.drift_m**2 * dt + noise.slip_m**2 * way
    r = noise.drift_rad**2 * dt + noise.slip_rad**2 * turn
    step = np.searchsorted(keyframes, at[1:]) - 1
    ends = poses[np.searchsorted(at, keyframes)]
    first, last = ends[:-1][step], ends[1:][step]
    d = np.einsum("kji,kj->ki", first.rotation, last.translation - poses.translation[1:])
    crossed = so3.hat(d)
    rotation = np.swapaxes(first.rotation, 1, 2) @ last.rotation
    each = np.zeros((len(step), 6, 6))
    each[:, :3, :3] = s[:, None, None] * np.eye(3) + r[:, None, None] * crossed @ np.swapaxes(crossed, 1, 2)
    each[:, :3, 3:] = -r[:, None, None] * crossed @ rotation
    each[:, 3:, :3] = np.swapaxes(each[:, :3, 3:], 1, 2)
    each[:, 3:, 3:] = r[:, None, None] * np.eye(3)
    return np.asarray(np.add.reduceat(each, np.searchsorted(step, np.arange(len(keyframes) - 1))))


def beside_the_line(track: Track, ticks: IntArray) -> Array:
    """How far from the straight line between two messages a robot may be at `ticks` (m,), one sigma of each number
    (m, 6) [m, rad]; 0 at a message. `track` has messages at rising ticks.

    With u = t1 t2 / dt^2, and d2, d3 the second and third differences of messages so far apart:

        sigma^2  =  (d2 u / 2)^2  +  d3^2 u / 6

    First what a smooth way is beside its chord, f'' t1 t2 / 2; then what a rough one may be: of a random walk third
    differences have 6 times the variance of a step, and it is u times that beside the line (a Brownian bridge).
    """
    if len(track) < 4:
        return np.zeros((len(ticks), 6))
    t = track.ticks / TICKS_PER_S
    dt = np.diff(t)
    turned = track.poses[1:].minus(track.poses[:-1])[:, 3:]
    velocity = np.concatenate([np.diff(track.poses.translation, axis=0), turned], -1) / dt[:, None]
    first = np.clip(np.searchsorted(track.ticks, ticks), 1, len(dt)) - 1
    at = np.clip(ticks, track.ticks[0], track.ticks[-1]) / TICKS_PER_S
    u = (at - t[first]) * (t[first + 1] - at) / dt[first] ** 2
    d2, d3 = (_largest_near(np.diff(velocity, order, axis=0), first, order) * dt[first, None] for order in (1, 2))
    sigma = np.sqrt((0.5 * u[:, None] * d2) ** 2 + d3**2 * u[:, None] / 6.0)
    return np.asarray(np.repeat(sigma, 3, axis=1))


def _largest_near(changes: Array, steps: IntArray, order: int) -> Array:
    """The RMS over the axes of moving and of turning (m, 2) of the largest of changes (n, 6) that have a part in some
    steps (m,): of `order` many more steps than one each."""
    size = np.stack([np.sqrt(np.mean(changes[:, part] ** 2, 1)) for part in (slice(0, 3), slice(3, 6))], -1)
    reached = np.clip(steps[:, None] - np.arange(order + 1), 0, len(size) - 1)
    return np.asarray(size[reached].max(1))


def diagonal(variances: Array) -> Array:
    """Covariances (..., k, k) of numbers that are independent."""
    return variances[..., None] * np.eye(variances.shape[-1])
