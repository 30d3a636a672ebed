"""Turns of odometry that were written in degrees, though only their remainder by whole turns is left of them.

11.46 degrees taken for radians are a heading of 11.46 - 2 * 2 pi. The sightings know better how far the robot turned: a
landmark seen at p_a from one pose and at p_b from the next is where p_a - t = R p_b, and all landmarks seen from both
give R by one rigid fit (those with an orientation Q also by Q_a = R Q_b). If what was written is that turn in degrees,
wrapped, then degrees(R) - written is near 0 at all steps; if not, it lies anywhere on the circle. Rayleigh's test tells
the one from the other (Mardia, Jupp, "Directional Statistics", 2000, sec. 6.3).
"""

from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, BoolArray, Pose
from teamslam.model import Dataset, Table, pack
from teamslam.model.sensors import pose_of
from teamslam.trust.causes.pairs import TRIANGLES, Look, pairs_of, places

FREE = 1e-3  # what the whitening of a turn is multiplied with that nobody saw
FEWEST = 10  # steps seen
SURE = 20.0  # n R^2 of Rayleigh's test: by chance once in 5e8
CLOSE = 0.5  # R at least


def turns_in_degrees(piece: Dataset, robot: int, odometry: Table) -> Table | None:
    """A robot's odometry with its turns as they were meant, if they are in degrees; None if they are not, or nobody
    saw."""
    steps = pose_of(odometry.values, odometry.dim)
    turn, seen = _turns_seen(piece, robot, odometry, steps)
    if np.count_nonzero(seen) < FEWEST:
        return None
    written = _yaw(steps.rotation)
    off = np.exp(1j * (np.degrees(turn) - written))[seen]
    if len(off) * np.abs(off.mean()) ** 2 < SURE or off.mean().real < CLOSE:
        return None
    whole = np.where(seen, np.rint((np.degrees(turn) - written) / (2.0 * np.pi)), 0.0)
    meant = np.radians(written + 2.0 * np.pi * whole)
    lengths = np.arange(odometry.whitening.shape[-1]) < odometry.dim
    loose = np.where(lengths | seen[:, None], 1.0, FREE)
    return replace(
        odometry,
        values=pack(Pose(steps.rotation @ _about_vertical(meant - written, steps.dim), steps.translation)),
        whitening=odometry.whitening * loose[:, None, :],
    )


def with_turns_in_radians(log: Dataset, robot: int) -> Dataset:
    """A log with the turns of a robot's odometry as they were meant, where they are in degrees; other tables, and turns
    that are right or that nobody saw, are the same objects."""
    mine = log.of_robot(robot)

    def meant(table: Table) -> Table:
        own = table.robot == robot and table.is_odometry
        return (turns_in_degrees(mine, robot, table) if own else None) or table

    return log.with_tables(map(meant, log.tables))


def _turns_seen(piece: Dataset, robot: int, odometry: Table, steps: Pose) -> tuple[Array, BoolArray]:
    """How far the robot turned about the vertical at each step (m,), by the landmarks seen from both its ends, and
    where they tell (m,)."""
    dim = max([odometry.dim, *(table.dim for table in piece.tables)])
    chain = piece.pose_keys[robot]
    start, stop = np.searchsorted(chain, odometry.keys).T
    product, count = np.zeros((len(odometry), dim, dim)), np.zeros(len(odometry), np.int64)
    order = np.argsort(start, kind="stable")
    for table in piece.tables:
        pairs = pairs_of(piece, robot, table)
        next_to = np.flatnonzero(pairs.after - pairs.before == 1)
        if TRIANGLES.get(table.model) is not places or not len(next_to):
            continue
        row = order[np.minimum(np.searchsorted(start[order], pairs.before[next_to]), len(order) - 1)]
        fits = (start[row] == pairs.before[next_to]) & (stop[row] == pairs.after[next_to])
        here, there = (Look.of(table, rows[next_to], dim) for rows in (pairs.first, pairs.second))
        moved = here.place - steps.lift(dim).translation[row]
        np.add.at(product, row[fits], (moved[:, :, None] * there.place[:, None, :])[fits])
        np.add.at(count, row[fits], 1)
        if here.turn is not None and there.turn is not None:
            np.add.at(product, row[fits], (here.turn @ np.swapaxes(there.turn, -1, -2))[fits])
            np.add.at(count, row[fits], dim)
    u, _, v = np.linalg.svd(product)
    signs = np.ones((len(odometry), dim))
    signs[:, -1] = np.linalg.det(u @ v)
    return _yaw((u * signs[:, None, :]) @ v), count >= dim - 1


def _yaw(rotation: Array) -> Array:
    """The turn about the vertical."""
    return np.asarray(np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))


def _about_vertical(angle: Array, dim: int) -> Array:
    """Rotations."""
    flat = np.zeros_like(angle)
    return Pose.from_xytheta(np.stack([flat, flat, angle], -1)).lift(dim).rotation
