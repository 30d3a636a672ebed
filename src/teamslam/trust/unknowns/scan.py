"""Clocks that are far off, by where robots were: what least squares needs to begin with.

What robots saw of landmarks makes a map without a word of who met whom. In it each sighting of a robot, from where the
observer was, says where the other was; the other's way says when it was there. By how much its stamps are late,

    min over d of   sum | z_i (-) h(X(t_i), Y(t_i + d)) |          d from a second before to a second after

in units of the measurement and by absolute values (`frontend.shifts`).
"""

from collections.abc import Iterator

import numpy as np

from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.shifts import REACH_S, SHIFTS_S, clearest
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.joining import Joined
from teamslam.model import Dataset, Submap, Table, Unknowns, index_of, robot_of

FEWEST = 4  # sightings


def without_meetings(log: Dataset) -> Dataset:
    """The log without sightings of robots."""
    return log.with_tables(table for table in log.tables if not table.observes_robots)


def scanned(joined: Joined, log: Dataset, unknowns: Unknowns) -> Array:
    """The values (k,) of the unknowns with clocks as a map of landmarks tells them, where it does."""
    values = unknowns.values.copy()
    for k, unknown in enumerate(unknowns.each):
        if unknown.clock_of:
            offs = [off for submap in joined.maps for off in _misses(submap, log, unknown.clock_of)]
            values[k] += _best(np.concatenate(offs, 1)) if offs else 0.0
    return values


def _best(off: Array) -> float:
    """The shift at which all sightings together miss least, of those (shifts, m) that can be told at all."""
    off = off[:, np.isfinite(off).all(0)]
    if off.shape[1] < FEWEST:
        return 0.0
    return clearest(off) or 0.0


def _misses(submap: Submap, log: Dataset, robot: int) -> Iterator[Array]:
    """How far sightings of a robot, and its own of others, are off (shifts, m), were its stamps later by each shift."""
    for table in log.tables:
        if not table.observes_robots:
            continue
        observers, targets = robot_of(table.keys).T
        for other in np.unique(targets).tolist():
            rows = np.flatnonzero((targets == other) & (observers != other))
            sign = (other == robot) - (table.robot == robot)
            ways = [submap.trajectory_keys(number) for number in (table.robot, other)]
            if not sign or not len(rows) or min(map(len, ways)) < 2:
                continue
            part = table.select(rows)
            part = part.select(_between(part.keys, ways))
            if len(part):
                yield _of_pair(submap, log, part, sign)


def _between(keys: IntArray, ways: list[IntArray]) -> BoolArray:
    inside = [(keys[:, n] >= way[0]) & (keys[:, n] <= way[-1]) for n, way in enumerate(ways)]
    return np.asarray(inside[0] & inside[1])


def _of_pair(submap: Submap, log: Dataset, part: Table, sign: int) -> Array:
    shifts = np.round(sign * SHIFTS_S / log.names.tick_s).astype(np.int64)
    eyes, _ = _at(submap, log, part.robot, index_of(part.keys[:, 0]))
    at = index_of(part.keys[:, 1]) + shifts[:, None]
    other = int(robot_of(part.keys[:1, 1])[0])
    found, good = _at(submap, log, other, at.ravel())
    rows = np.tile(np.arange(len(part)), len(shifts))
    many = part.select(rows)
    off = many.row.minus(many.values, many.predict_from(eyes[rows], found), many.dim)
    missed = np.where(good, np.abs(off).sum(-1), np.nan)
    return np.asarray(missed.reshape(len(shifts), len(part)))


def _at(submap: Submap, log: Dataset, robot: int, ticks: IntArray) -> tuple[Pose, BoolArray]:
    keys = submap.trajectory_keys(robot)
    poses = submap.all_values.poses_of(keys, log.robots[robot])
    return interpolate(index_of(keys), poses, ticks, round(2.0 * REACH_S / log.names.tick_s))
