"""Teams of robots on the ground and in the air: whoever sees both has rows of the plane and of space of one sensor."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, TrustOptions
from teamslam.errors import TeamslamError
from teamslam.geometry import Pose, compose_along, concatenate
from teamslam.model import Dataset, Kind, Names, Table, Values, index_of, landmark_key, pose_key, robot_of
from thinned import thinned
from worlds import chain, measure

DIMS = {1: 2, 2: 2, 3: 3, 4: 3}
POSES, LANDMARKS, SIGMA = 14, 5, 0.02
STEPS = {2: [0.7, 0, 0.2], 3: [0.7, 0, 0, 0.02, 0.03, 0.2]}


def mixed(of_robots: str = "relative_pose", of_landmarks: str = "point", seed: int = 0) -> Dataset:
    """Two robots on a floor and two above it, among marks on the floor. Everybody sees everybody, in the plane where
    both are on the ground; robots on the ground see every other mark in space, the rest in the plane."""
    rng = np.random.default_rng(seed)
    keys = {robot: pose_key(robot, np.arange(POSES)) for robot in DIMS}
    ways = {robot: _way(dim, rng) for robot, dim in DIMS.items()}
    marks = landmark_key(np.arange(LANDMARKS))
    places = rng.uniform(-5.0, 5.0, (LANDMARKS, 3)) * [1.0, 1.0, 0.0]
    parts = {
        kind: (np.concatenate([keys[r] for r in of]), concatenate([ways[r] for r in of]))
        for kind, of in ((Kind.POSE2, (1, 2)), (Kind.POSE3, (3, 4)))
    }
    truth = Values.of({**parts, Kind.POINT3: (marks, places)})
    tables = []
    for robot, dim in DIMS.items():
        own = keys[robot]
        tables.append(measure(robot, "odometry", "relative_pose", dim, chain(own), SIGMA, truth, rng))
        pairs = np.stack([np.repeat(own, LANDMARKS), np.tile(marks, POSES)], -1)
        in_space = (dim == 3) | (index_of(pairs[:, 1]) % 2 == 0)
        seen = [(3, pairs[in_space]), (2, pairs[~in_space])]
        tables += _one_sensor(robot, "landmarks", of_landmarks, seen, truth, rng)
        met = [(max(dim, DIMS[r]), np.stack([own, keys[r]], -1)[::2]) for r in DIMS if r != robot]
        tables += _one_sensor(robot, "robots", of_robots, met, truth, rng)
    return Dataset(DIMS, tuple(tables), Names(tick_s=1.0), truth)


def _way(dim: int, rng: np.random.Generator) -> Pose:
    turn = rng.uniform(-2.0, 2.0, 2 * dim - 3)
    first = Pose.from_tangent(np.concatenate([rng.uniform(-3.0, 3.0, dim), turn]), dim)
    return first @ compose_along(Pose.from_tangent(np.tile(STEPS[dim], (POSES - 1, 1)), dim))


def _one_sensor(
    robot: int, source: str, model: str, seen: list[tuple[int, np.ndarray]], truth: Values, rng: np.random.Generator
) -> list[Table]:
    """What one sensor measures, a table for each dimension, numbered one after the other."""
    tables, start = [], 0
    for dim in (2, 3):
        pairs = [keys for d, keys in seen if d == dim and len(keys)]
        if pairs:
            table = measure(robot, source, model, dim, np.concatenate(pairs), SIGMA, truth, rng)
            tables.append(replace(table, ids=table.ids + start))
            start += len(table)
    return tables


# --- what may be wrong ------------------------------------------------------------------------------------------------


def _nothing(table: Table) -> Table:
    return table


def _sure(table: Table) -> Table:
    """Standard deviations that are three times too small."""
    return replace(table, whitening=3.0 * table.whitening) if table.source != "odometry" else table


def _outliers(table: Table) -> Table:
    if table.source == "odometry":
        return table
    values = table.values.copy()
    values[::6, 0] += 4.0
    return replace(table, values=values)


def _names(first: np.ndarray, second: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda keys: np.where(keys == first, second, np.where(keys == second, first, keys))


def _swapped_marks(table: Table) -> Table:
    """Robot 1 exchanges two marks, of which it sees one in space and one in the plane."""
    if table.robot != 1 or table.source != "landmarks":
        return table
    swap = _names(landmark_key(0), landmark_key(1))
    return replace(table, keys=np.stack([table.keys[:, 0], swap(table.keys[:, 1])], -1))


def _taken(one: int, other: int, by: int) -> Callable[[Table], Table]:
    """A robot takes one of two others for the other, and the other way round."""

    def taken(table: Table) -> Table:
        if table.robot != by or table.source != "robots":
            return table
        target = table.keys[:, 1]
        named = pose_key(_names(np.array(one), np.array(other))(robot_of(target)), index_of(target))
        return replace(table, keys=np.stack([table.keys[:, 0], named], -1))

    return taken


def _loud_odometry(table: Table) -> Table:
    return (
        replace(table, whitening=10.0 * table.whitening) if table.source == "odometry" and table.robot == 2 else table
    )


FAULTS: dict[str, Callable[[Table], Table]] = {
    "nothing": _nothing,
    "sigmas too small": _sure,
    "outliers": _outliers,
    "marks exchanged": _swapped_marks,
    "robots in the air exchanged": _taken(3, 4, by=1),
    "robots of the plane and of space exchanged": _taken(1, 2, by=3),
    "odometry too sure": _loud_odometry,
}
WAYS = {
    "as it is": Config(),
    "rejecting": Config(trust=TrustOptions(reject=True)),
    "repairing": Config(trust=TrustOptions(repair=True)),
    "calibrating": Config(calibrate=True),
    "full, all of it": Config(method="full", calibrate=True, trust=TrustOptions(reject=True, repair=True)),
}


@pytest.mark.parametrize(("fault", "way"), thinned(3, [*FAULTS], [*WAYS]))
def test_a_mixed_team_ends_with_an_answer_or_a_sentence(fault: str, way: str) -> None:
    models = ("relative_pose", "point", "range")
    log = mixed(models[(list(FAULTS).index(fault) + list(WAYS).index(way)) % 3])
    log = log.with_tables(map(FAULTS[fault], log.tables))
    try:
        result = ts.run(log, WAYS[way])
    except TeamslamError as error:
        assert str(error)
    else:
        assert result.verdict.level != "unknown"
        if fault == "nothing":
            assert result.verdict.level == "fits"
