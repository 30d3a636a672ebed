"""Teams that know of each other by ranges alone, each on a way of its own; where the first of them surfaced, it is told
its position in the world."""

import numpy as np

from teamslam.geometry import Array, Pose, compose_along, concatenate
from teamslam.model import Dataset, Names, Values, pose_key, pose_kind
from worlds import chain, measure

ODOMETRY, RANGE, FIX = 0.02, 0.1, 0.5  # sigmas: [m] and [rad] a step; [m]


def divers(seed: int, *, dim: int = 3, robots: int = 3, poses: int = 24, fixes: int = 4) -> Dataset:
    """`robots` on ways that wind at random; each is told at every second pose how far the next one is, and the first
    where it is in the world, `fixes` times."""
    rng = np.random.default_rng(seed)
    keys = [pose_key(robot, np.arange(poses)) for robot in range(1, robots + 1)]
    ways = []
    for _ in keys:
        first = Pose.from_tangent(np.concatenate([rng.uniform(-15.0, 15.0, dim), _turned(rng, dim)]), dim)
        steps = np.zeros((poses - 1, 3 * (dim - 1)))
        steps[:, 0] = 1.5
        turns = steps[:, dim:]
        turns += rng.normal(0.0, 0.1, turns.shape[1]) + rng.normal(0.0, 0.05, turns.shape)
        ways.append(first @ compose_along(Pose.from_tangent(steps, dim)))
    truth = Values.of({pose_kind(dim): (np.concatenate(keys), concatenate(ways))})
    tables = [
        measure(n + 1, "odometry", "relative_pose", dim, chain(own), ODOMETRY, truth, rng) for n, own in enumerate(keys)
    ]
    for n, own in enumerate(keys[: robots if robots > 2 else 1]):
        told = np.stack([own, keys[(n + 1) % robots]], -1)[::2]
        tables.append(measure(n + 1, "robots", "range", dim, told, RANGE, truth, rng))
    if fixes:
        seen = keys[0][np.linspace(0, poses - 1, fixes).astype(int), None]
        tables.append(measure(1, "fixes", "position", dim, seen, FIX, truth, rng))
    return Dataset(dict.fromkeys(range(1, robots + 1), dim), tuple(tables), Names(tick_s=1.0), truth)


def _turned(rng: np.random.Generator, dim: int) -> Array:
    heading = rng.uniform(-np.pi, np.pi, 1)
    return heading if dim == 2 else np.concatenate([rng.normal(0.0, 0.1, 2), heading])
