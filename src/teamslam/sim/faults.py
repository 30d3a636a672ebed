"""Faults planted in a simulated team's log: names that lie, robots that lie, sightings that are wrong.

Each takes a log with its truth and gives one that could have come from a faulty team, so that what finds faults can be
counted. Law: of a share, a length or a turn of nothing the log comes back with equal rows.
"""

from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, BoolArray, Pose
from teamslam.model import Dataset, Kind, Table, Values, index_of, pose_key, robot_of
from teamslam.sim import noise


def exchanged(log: Dataset, robot: int, one: int, other: int) -> Dataset:
    """A robot calls two landmarks by each other's names."""
    names = {one: other, other: one}

    def renamed(table: Table) -> Table:
        if table.robot != robot or table.source != "landmarks":
            return table
        keys = table.keys.copy()
        keys[:, 1] = [names.get(key, key) for key in keys[:, 1].tolist()]
        return replace(table, keys=keys)

    return log.with_tables(map(renamed, log.tables))


def taken_for_another(log: Dataset, robot: int, one: int, other: int) -> Dataset:
    """A robot takes two others for each other, in all its sightings of them."""
    names = {one: other, other: one}

    def renamed(table: Table) -> Table:
        if table.robot != robot or table.source != "robots":
            return table
        keys = table.keys.copy()
        seen = robot_of(keys[:, 1])
        keys[:, 1] = pose_key(np.array([names.get(who, who) for who in seen.tolist()]), index_of(keys[:, 1]))
        known = np.isin(keys[:, 1], np.concatenate(list(log.pose_keys.values())))
        return replace(table, keys=keys).select(known)

    return log.with_tables(map(renamed, log.tables))


def moved(log: Dataset, robots: tuple[int, ...], mark: int, by: Array) -> Dataset:
    """Some robots saw a landmark when it stood elsewhere (sightings of points)."""
    truth = log.truth
    assert truth is not None
    kind = Kind(int(truth.layout.kinds[truth.layout.index(np.array(mark))]))
    place = truth.gather(np.array([mark]), kind)
    assert not isinstance(place, Pose)
    there = truth.update(Values.of({kind: (np.array([mark]), place + by)}))

    def seen(table: Table) -> Table:
        if table.robot not in robots or table.source != "landmarks":
            return table
        return replace(table, values=table.values + table.predict(there) - table.predict(truth))

    return log.with_tables(map(seen, log.tables))


def stretched(log: Dataset, robot: int, times: float) -> Dataset:
    """All lengths that a robot measures are longer (points and relative poses)."""

    def longer(table: Table) -> Table:
        if table.robot != robot:
            return table
        values = table.values.copy()
        values[:, : table.dim] *= times
        return replace(table, values=values)

    return log.with_tables(map(longer, log.tables))


def turning(log: Dataset, robot: int, by: float) -> Dataset:
    """A robot's odometry turns too far at every step [rad]."""

    def turned(table: Table) -> Table:
        if table.robot != robot or table.source != "odometry":
            return table
        d = table.dim
        turn = Pose.from_xytheta(np.array([0.0, 0.0, by])).lift(d).rotation
        rotation = table.values[:, d:].reshape(-1, d, d) @ turn
        return replace(table, values=np.concatenate([table.values[:, :d], rotation.reshape(-1, d * d)], 1))

    return log.with_tables(map(turned, log.tables))


def made_up(log: Dataset, robot: int, seed: int) -> Dataset:
    """A robot invents where landmarks are: its sightings are of another world, and at one with each other."""
    truth = log.truth
    assert truth is not None
    marks = log.landmark_keys
    kind = Kind(int(truth.layout.kinds[truth.layout.index(marks[0])]))
    places = truth.gather(marks, kind)
    assert not isinstance(places, Pose)
    invented = np.random.default_rng(seed).uniform(places.min(0), places.max(0), places.shape)
    elsewhere = truth.update(Values.of({kind: (marks, invented)}))

    def seen(table: Table) -> Table:
        if table.robot != robot or table.source != "landmarks":
            return table
        return replace(table, values=table.values + table.predict(elsewhere) - table.predict(truth))

    return log.with_tables(map(seen, log.tables))


def aliased(log: Dataset, share: float, of_robots: float, seed: int) -> tuple[Dataset, list[BoolArray]]:
    """A share of each robot's sightings of a landmark is of another one, the same each time; of sightings of robots, of
    another robot. With the rows that are wrong, by table."""
    truth, rng = log.truth, np.random.default_rng([seed, 77])
    assert truth is not None
    tables, wrong = [], []
    for table in log.tables:
        keys, bad = table.keys.copy(), np.zeros(len(table), bool)
        if table.source == "landmarks":
            marks = rng.permutation(np.unique(keys[:, 1]))
            other = dict(zip(marks.tolist(), np.roll(marks, 1).tolist(), strict=True))
            bad = rng.random(len(table)) < share
            keys[bad, 1] = [other[mark] for mark in keys[bad, 1].tolist()]
        elif table.source == "robots" and len(log.robots) > 2:
            bad = rng.random(len(table)) < of_robots
            for row in np.flatnonzero(bad).tolist():
                seen = int(robot_of(keys[row, 1]))
                other_robot = next(r for r in log.robots if r not in (table.robot, seen))
                keys[row, 1] = pose_key(other_robot, int(index_of(keys[row, 1])))
        bad &= truth.layout.contains(keys).all(1)
        at = replace(table, keys=np.where(bad[:, None], keys, table.keys))
        errors = rng.standard_normal((len(table), table.row.residual_rows(table.dim))) / np.diag(table.whitening[0])
        values = noise.plus(table.model, at.predict(truth), errors, table.dim)
        tables.append(replace(table, values=np.where(bad[:, None], values, table.values)))
        wrong.append(bad)
    return log.with_tables(tables), wrong
