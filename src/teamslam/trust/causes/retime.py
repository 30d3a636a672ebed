"""Robots whose clocks do not agree: what they saw of each other, said of the poses where they were.

Robot r's clock is d ahead. Whoever else sees it at t sees the pose that r itself calls t + d; what r sees of another at
its own t is that one's pose at t - d. Where a robot's odometry has no pose at such a moment, the step across it is cut
in two: its place by the share of the time, its noise too.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Dataset, Table, index_of, is_pose, pack, pose_key, robot_of
from teamslam.model.sensors import pose_of


def with_clock_ahead(log: Dataset, robot: int, ticks: int) -> Dataset:
    """A team's log in which one robot's clock is `ticks` ahead of the others' (behind, where below 0): the same rows,
    of the poses they were taken of. Those beyond the ends of anybody's odometry are left out."""
    tables = [_of_true_poses(table, robot, ticks, log.pose_keys) for table in log.tables]
    named = np.concatenate([np.zeros(0, np.int64), *(t.keys[is_pose(t.keys)] for t in tables)])
    cuts = np.setdiff1d(named, np.concatenate(list(log.pose_keys.values())))
    return log.with_tables(_cut(t, cuts) if _is_chain(t) else t for t in tables if len(t))


def _of_true_poses(table: Table, robot: int, ticks: int, chains: Mapping[int, IntArray]) -> Table:
    """A table whose sightings of robots name the poses seen: of the robot later, by the robot earlier."""
    target, others = table.keys[:, -1], table.keys.shape[1] == 2
    links = is_pose(target) & (robot_of(target) != table.robot) & others
    links &= (robot_of(target) == robot) | (table.robot == robot)
    if not links.any():
        return table
    at = index_of(target) + np.where(links, ticks if table.robot != robot else -ticks, 0)
    ends = {who: index_of(chains[who][[0, -1]]) for who in np.unique(robot_of(target[links])).tolist()}
    good = ~links
    for who, (first, last) in ends.items():
        good |= (robot_of(target) == who) & (at >= first) & (at <= last)
    keys = table.keys.copy()
    moved = links & good
    keys[moved, -1] = pose_key(robot_of(target[moved]), at[moved])
    return replace(table, keys=keys).select(good)


def _is_chain(table: Table) -> bool:
    return table.model == "relative_pose" and bool((robot_of(table.keys) == table.robot).all())


def _cut(table: Table, cuts: IntArray) -> Table:
    """Odometry with poses between its own, where there are cuts."""
    start, stop = table.keys.T
    inside = np.searchsorted(cuts, stop, side="left") > np.searchsorted(cuts, start, side="right")
    if not inside.any():
        return table
    whitening = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
    keys, values, spread = [table.keys[~inside]], [table.values[~inside]], [whitening[~inside]]
    for n in np.flatnonzero(inside).tolist():
        ends = np.concatenate([[start[n]], cuts[(cuts > start[n]) & (cuts < stop[n])], [stop[n]]])
        share = (ends - start[n]) / (stop[n] - start[n])
        way = _along(pose_of(table.values[n : n + 1], table.dim), share)
        keys.append(np.stack([ends[:-1], ends[1:]], -1))
        values.append(pack(way[:-1].between(way[1:])))
        spread.append(whitening[n] / np.sqrt(np.diff(share))[:, None, None])
    all_keys = np.concatenate(keys)
    order = np.argsort(all_keys[:, 0], kind="stable")
    return replace(
        table,
        keys=all_keys[order],
        values=np.concatenate(values)[order],
        whitening=np.concatenate(spread)[order],
        ids=np.arange(len(all_keys)),
    )


def _along(step: Pose, share: Array) -> Pose:
    """Poses on the way to the end of a step."""
    still = Pose.identity(step.dim, (len(share),))
    return still.retract(share[:, None] * step.minus(Pose.identity(step.dim, (1,))))
