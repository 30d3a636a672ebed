"""How robots move: controls in, true poses out.

The ground robot is a differential drive (paper, eq. 15, whose signs are corrected on the theory page). Over one step it
runs along an arc: with the length l = v dt and the turn a = w dt,

    x' = x + s cos(th + a/2)     y' = y + s sin(th + a/2)     th' = th + a     with s = l sin(a/2) / (a/2)

which equals the textbook form with v/w and has no singularity for a robot that drives straight on.
A flying robot follows the same track over ground, rises and sinks along it, pitches with the climb and banks in turns.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose, so3

_SHARPEST = 0.5  # turn of a wandering robot in one step, at most [rad]
_WAVELENGTH = 40.0  # of a flying robot's rise and fall, in steps
_BANK = 0.5  # roll for each radian of turn


@dataclass(frozen=True)
class Arena:
    """A square of `side_m`, centred on the origin, `height_m` high."""

    side_m: float
    height_m: float


def drive(start: Array, length: Array, turn: Array) -> Array:
    """The track (..., n + 1, 3) of x, y [m], heading [rad] from `start` (..., 3), by n arcs (..., n)."""
    heading = start[..., 2:] + np.concatenate([np.zeros_like(start[..., 2:]), np.cumsum(turn, -1)], -1)
    chord = length * np.sinc(0.5 * turn / np.pi)  # numpy's sinc(x) is sin(pi x) / (pi x)
    middle = heading[..., :-1] + 0.5 * turn
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)], -1)
    xy = start[..., None, :2] + np.concatenate([np.zeros_like(steps[..., :1, :]), np.cumsum(steps, -2)], -2)
    return np.concatenate([xy, heading[..., None]], -1)


def fly(track: Array, height_m: float, rng: np.random.Generator) -> Pose:
    """Poses of space over a ground track (n, 3): between a quarter and three quarters of `height_m`."""
    n = len(track)
    angle = 2.0 * np.pi * (np.arange(n) / _WAVELENGTH + rng.random())
    height = height_m * (0.5 + 0.25 * np.sin(angle))
    ground = np.gradient(track[:, :2], axis=0) if n > 1 else np.ones((n, 2))
    climb = np.gradient(height) if n > 1 else np.zeros(n)
    pitch = -np.arctan2(climb, np.maximum(np.linalg.norm(ground, axis=-1), 1e-9))
    roll = _BANK * (np.gradient(track[:, 2]) if n > 1 else np.zeros(n))
    rotation = _about(2, track[:, 2]) @ _about(1, pitch) @ _about(0, roll)
    return Pose(rotation, np.concatenate([track[:, :2], height[:, None]], -1))


def _about(axis: int, angle: Array) -> Array:
    return so3.exp(angle[:, None] * np.eye(3)[axis])


# --- where to go: tracks (robots, poses, 3) ---------------------------------------------------------------------------


def random_walk(robots: int, poses: int, step_m: float, arena: Arena, rng: np.random.Generator) -> Array:
    """Wandering: the turn drifts at random, and bends back to the middle near the edge."""
    start = _anywhere(robots, arena, rng)
    noise = rng.normal(0.0, 0.15, (poses - 1, robots))
    turns, here, turn = np.zeros((robots, poses - 1)), start, np.zeros(robots)
    for k in range(poses - 1):
        turn = 0.8 * turn + noise[k]
        homewards = np.arctan2(-here[:, 1], -here[:, 0]) - here[:, 2]
        homewards = (homewards + np.pi) % (2.0 * np.pi) - np.pi
        outside = np.abs(here[:, :2]).max(-1) > 0.4 * arena.side_m
        turn = np.clip(np.where(outside, 0.5 * homewards, turn), -_SHARPEST, _SHARPEST)
        here = drive(here, np.full((robots, 1), step_m), turn[:, None])[:, -1]
        turns[:, k] = turn
    return drive(start, np.full((robots, poses - 1), step_m), turns)


def circles(robots: int, poses: int, step_m: float, arena: Arena, rng: np.random.Generator) -> Array:
    """Each robot round a circle of its own; the circles overlap around the middle of the arena."""
    radius = 0.3 * arena.side_m
    around = 2.0 * np.pi * (np.arange(robots) / robots + rng.random())
    centre = 0.15 * arena.side_m * np.stack([np.cos(around), np.sin(around)], -1)
    phase = rng.uniform(-np.pi, np.pi, robots)
    xy = centre + radius * np.stack([np.cos(phase), np.sin(phase)], -1)
    start = np.concatenate([xy, phase[:, None] + 0.5 * np.pi], -1)
    shape = (robots, poses - 1)
    return drive(start, np.full(shape, step_m), np.full(shape, step_m / radius))


def lawn_mower(robots: int, poses: int, step_m: float, arena: Arena, rng: np.random.Generator) -> Array:
    """Each robot up and down the lanes of its own strip of the arena, and back again when it is through."""
    strip = 0.9 * arena.side_m / robots
    steps_turn = max(2, round(np.pi * min(1.0, 0.1 * arena.side_m) / step_m))
    lane_m = 2.0 * step_m * steps_turn / np.pi
    lanes = max(2, int(strip / lane_m) + 1)
    steps_leg = max(1, round((0.9 * arena.side_m - lane_m) / step_m))
    # Lanes are numbered 0, 1, ..., lanes - 1, lanes - 2, ..., 0, 1, ...: a turn at the top of a lane is to the right on
    # the way out and to the left on the way back, at the bottom the other way round.
    leg, within = np.divmod(np.arange(poses - 1), steps_leg + steps_turn)
    outwards = np.where((leg // (lanes - 1)) % 2 == 0, 1.0, -1.0)
    at_top = np.where(leg % 2 == 0, 1.0, -1.0)
    turn = np.where(within < steps_leg, 0.0, -outwards * at_top * np.pi / steps_turn)
    left = -0.45 * arena.side_m + strip * np.arange(robots) + 0.5 * (strip - lane_m * (lanes - 1))
    bottom = np.full(robots, -0.5 * steps_leg * step_m)
    start = np.stack([left, bottom, np.full(robots, 0.5 * np.pi)], -1)
    return drive(start, np.full((robots, poses - 1), step_m), np.broadcast_to(turn, (robots, poses - 1)))


PATHS: dict[str, Callable[[int, int, float, Arena, np.random.Generator], Array]] = {
    "random_walk": random_walk,
    "circles": circles,
    "lawn_mower": lawn_mower,
}


def _anywhere(robots: int, arena: Arena, rng: np.random.Generator) -> Array:
    xy = rng.uniform(-0.35, 0.35, (robots, 2)) * arena.side_m
    return np.concatenate([xy, rng.uniform(-np.pi, np.pi, (robots, 1))], -1)


MOVES: dict[int, Callable[[Array, float, np.random.Generator], Pose]] = {
    2: lambda track, height_m, rng: Pose.from_xytheta(track),
    3: fly,
}
"""How a robot of each dimension follows a track over ground (n, 3): track, height of the world [m], chance -> poses."""
