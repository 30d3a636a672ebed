"""Clocks that do not agree: the sightings of a robot are stamped later or earlier than its odometry.

What was seen at t is said of t + d. The odometry knows where the robot was at each moment, so the mistake is undone by
taking the odometry between two stamps as it is d earlier. A robot that goes on as it does would not notice; one that
turns or stops does, and the triangles of two looks (see `pairs`) close best at the right d.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.start.dead_reckoning import dead_reckoning
from teamslam.model import Dataset, Kind, Table, Values, index_of, is_pose, pack, robot_of

LEAST = 0.05  # of a usual step between poses: a clock that is off by less is not worth a word
STEPS = (0.125, 0.25, 0.375, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
"""Offsets to try first, in usual steps between poses."""
REFINEMENTS = 12


def offset(chain: IntArray, badness: Callable[[float], float]) -> float:
    """By how many ticks the odometry along a chain of poses is to be taken earlier to be least bad."""
    usual = usual_step(chain)
    return least_bad([sign * share * usual for share in STEPS for sign in (1.0, -1.0)], badness)


def usual_step(chain: IntArray) -> float:
    """The ticks between two poses of a chain."""
    return float(np.median(np.diff(index_of(chain)))) if len(chain) > 1 else 1.0


def least_bad(tried: Sequence[float], badness: Callable[[float], float]) -> float:
    """The offset that is least bad, of those tried, none at all, and what lies between the best and its neighbours."""
    known = {ticks: badness(ticks) for ticks in (0.0, *tried)}
    for _ in range(REFINEMENTS):
        order = sorted(known)
        place = order.index(min(known, key=lambda ticks: known[ticks]))
        gaps = [(order[n + 1] - order[n], n) for n in (place - 1, place) if 0 <= n < len(order) - 1]
        left = max(gaps)[1]
        between = 0.5 * (order[left] + order[left + 1])
        known[between] = badness(between)
    return min(known, key=lambda ticks: known[ticks])


def earlier(piece: Dataset, robot: int, ticks: float) -> Dataset:
    """A robot's piece of log with its odometry taken so much earlier (later, where below 0): between the same stamps,
    what it did `ticks` before. ModelError where the chain of odometry is broken."""
    chain = piece.pose_keys[robot]
    way = dead_reckoning(piece, robot).poses_of(chain, piece.robots[robot])
    moved = taken_earlier(chain, way, ticks)
    return piece.with_tables(_along(t, chain, moved) if t.robot == robot else t for t in piece.tables)


def taken_earlier(chain: IntArray, way: Pose, ticks: float) -> Pose:
    """Where the robot was so much before each pose of its chain."""
    stamps = index_of(chain)
    return _at(stamps, way, np.asarray(stamps - ticks, float))


def _along(table: Table, chain: IntArray, way: Pose) -> Table:
    """Odometry as the way has it; other tables as they are."""
    if not table.is_odometry or not (robot_of(table.keys) == table.robot).all():
        return table
    places = np.searchsorted(chain, table.keys)
    return replace(table, values=pack(way[places[:, 0]].between(way[places[:, 1]])))


def at_other_times(values: Values, robots: Sequence[int], ticks: float) -> Values:
    """An estimate in which some robots' poses are where they will be `ticks` later; those that leave their ways by that
    are left out."""
    moved = values
    for robot in robots:
        keys = values.layout.keys[is_pose(values.layout.keys) & (robot_of(values.layout.keys) == robot)]
        if len(keys) < 2:
            continue
        kind = Kind(int(values.layout.kinds[values.layout.index(keys[0])]))
        at = np.asarray(index_of(keys) + ticks, float)
        inside = (at >= index_of(keys[0])) & (at <= index_of(keys[-1]))
        moved = moved.select(~np.isin(moved.layout.keys, keys[~inside]))
        later = _at(index_of(keys), values.poses_of(keys, kind.dim), at)
        moved = moved.update(Values.of({kind: (keys[inside], later[np.flatnonzero(inside)])}))
    return moved


def _at(stamps: IntArray, poses: Pose, at: Array) -> Pose:
    """Poses at any moments (n,): between those known, and on from the first and last as they began and ended."""
    left = np.clip(np.searchsorted(stamps, at, side="right") - 1, 0, len(stamps) - 2)
    before, after = poses[left], poses[left + 1]
    share = (at - stamps[left]) / np.maximum(stamps[left + 1] - stamps[left], 1)
    return before.retract(share[:, None] * after.minus(before))
