"""Steps and sightings in the axes of the odometry's own frame, where they are meant to be seen from the robot.

Who takes the difference of two odometry poses forgets to turn it into the robot's axes; who logs where a landmark is
logs it in the frame of the odometry. Undone, with h the heading and T the pose that the odometry has in its frame:

    step       t  =  R(h)' dx         h at the start is where most steps lead ahead: robots drive forward
    sighting   z  =  T^-1 x           T is the identity at the start of each run of odometry
"""

from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, compose_along
from teamslam.model import Dataset, Table, pack
from teamslam.model.sensors import pose_of


def with_steps_in_its_axes(log: Dataset, robot: int) -> Dataset:
    """A log with the steps of a robot's odometry turned from the axes of their frame into its own; other tables, and
    those of robots in space, are the same objects."""
    return log.with_tables(_turned(table) if _steps(table, robot) else table for table in log.tables)


def with_points_seen_from_it(log: Dataset, robot: int, source: str) -> Dataset:
    """A log with the points of some source that a robot saw brought from the frame of its odometry into its own; other
    tables are the same objects."""
    way = _way(log, robot)

    def seen(table: Table) -> Table:
        if way is None or not _points(table, robot) or table.source != source:
            return table
        keys, poses = way
        at = np.minimum(np.searchsorted(keys, table.keys[:, 0]), len(keys) - 1)
        known = keys[at] == table.keys[:, 0]
        there = poses[at].inverse().act(table.values)
        return replace(table, values=np.where(known[:, None], there, table.values))

    return log.with_tables(map(seen, log.tables))


def _steps(table: Table, robot: int) -> bool:
    return table.robot == robot and table.is_odometry and table.dim == 2 and len(table) > 1 and bool(table.own.all())


def _points(table: Table, robot: int) -> bool:
    return table.robot == robot and table.model == "point" and table.dim == 2 and table.sensor is None


def points_of(log: Dataset, robot: int) -> list[str]:
    """The sources of points that a robot saw in the plane by no sensor of a place of its own."""
    return list(dict.fromkeys(table.source for table in log.tables if _points(table, robot)))


def _runs(keys: IntArray) -> tuple[IntArray, IntArray]:
    """The order in time of steps (m, 2), and where in it each run of steps that follow each other begins."""
    order = np.argsort(keys[:, 0], kind="stable")
    ends = keys[order]
    return order, np.flatnonzero(np.append(True, ends[1:, 0] != ends[:-1, 1]))


def _turned(table: Table) -> Table:
    x, y, turn = pose_of(table.values, 2).xytheta().T
    order, begins = _runs(table.keys)
    heading = np.zeros(len(table))
    for rows in np.split(order, begins[1:]):
        half_way = np.cumsum(turn[rows]) - 0.5 * turn[rows]
        moved = (x[rows] + 1j * y[rows]) * np.exp(-1j * half_way)
        heading[rows] = half_way - 0.5 * turn[rows] + np.angle(moved.sum())
    step = (x + 1j * y) * np.exp(-1j * heading)
    return replace(table, values=pack(Pose.from_xytheta(np.stack([step.real, step.imag, turn], -1))))


def _way(log: Dataset, robot: int) -> tuple[IntArray, Pose] | None:
    """A robot's poses by its odometry, each run of it from the identity on."""
    keys, poses = list[IntArray](), list[Array]()
    for table in log.tables:
        if _steps(table, robot):
            order, begins = _runs(table.keys)
            for rows in np.split(order, begins[1:]):
                way = compose_along(pose_of(table.values[rows], 2))
                keys.append(np.append(table.keys[rows[0], 0], table.keys[rows, 1]))
                poses.append(way.xytheta())
    if not keys:
        return None
    at, first = np.unique(np.concatenate(keys), return_index=True)
    return at, Pose.from_xytheta(np.concatenate(poses)[first])
