"""Stretches of a team's log that are short enough to be solved again and again."""

from collections.abc import Sequence

import numpy as np

from teamslam.answers.residuals import observers
from teamslam.geometry import Array, BoolArray
from teamslam.model import Dataset, Table, index_of, is_landmark, is_pose, robot_of
from teamslam.trust.residuals import Rows

POSES = 40  # of each robot, about
STARTS = 24  # windows of time that are looked at
CAP = 25.0  # of a squared residual: what is more is as bad


def busiest(log: Dataset, rows: Sequence[Rows] = ()) -> Dataset:
    """A window of time of about POSES poses a robot: the one in which robots disagree most at the map, where `rows` are
    the residuals there, or have most to do with each other, where there is no map."""
    ticks = index_of(np.concatenate(list(log.pose_keys.values())))
    start, stop = int(ticks.min()), int(ticks.max()) + 1
    width = (stop - start) * POSES * len(log.robots) / max(len(ticks), 1)
    if width >= stop - start:
        return log
    at, weight = _links(log, rows)
    begins = np.linspace(start, stop - width, STARTS)
    held = [float(weight[(at >= begin) & (at < begin + width)].sum()) for begin in begins]
    begin = begins[int(np.argmax(held))]
    return within(log, begin, begin + width)


def within(log: Dataset, start: float, stop: float) -> Dataset:
    """The rows all of whose poses lie in a window of ticks, with odometry, and without robots that have none there."""
    tables = [table.select(_inside(table, start, stop)) for table in log.tables]
    moved = {t.robot for t in tables if len(t) and (robot_of(t.keys) == t.robot).all()}
    robots = np.array([0, *moved])
    tables = [t.select(np.asarray(np.isin(robot_of(t.keys), robots).all(1))) for t in tables if t.robot in moved]
    return log.with_tables(t for t in tables if len(t))


def _inside(table: Table, start: float, stop: float) -> BoolArray:
    ticks = index_of(table.keys)
    return np.asarray((~is_pose(table.keys) | ((ticks >= start) & (ticks < stop))).all(1))


def _links(log: Dataset, rows: Sequence[Rows]) -> tuple[Array, Array]:
    """When robots saw each other or the same landmarks, and how badly each row fits."""
    marks: dict[int, set[int]] = {}
    for table in log.tables:
        for mark in np.unique(table.keys[:, -1][is_landmark(table.keys[:, -1])]).tolist():
            marks.setdefault(mark, set()).add(table.robot)
    shared = np.array([mark for mark, seers in marks.items() if len(seers) > 1], np.int64)
    at, weight = [np.zeros(0)], [np.zeros(0)]
    known = [(r.table, r.squared) for r in rows] or [(table, np.zeros(len(table))) for table in log.tables]
    for table, squared in known:
        target = table.keys[:, -1]
        links = np.isin(target, shared) | (is_pose(target) & (robot_of(target) != table.robot))
        at.append(index_of(observers(table)[links]).astype(float))
        weight.append(1.0 + np.minimum(squared[links], CAP))
    return np.concatenate(at), np.concatenate(weight)
