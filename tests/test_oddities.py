"""Slips of the hand are told before anything is solved, each where it was planted, and none in logs without one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import faults
import teamslam as ts
from teamslam.geometry import Array, Pose
from teamslam.model import Dataset, Names, Table, Values, index_of, is_landmark, is_pose, pack, pose_key, robot_of
from teamslam.model.sensors import pose_of
from teamslam.oddities import oddities
from teamslam.sim import Options, simulate
from thinned import thinned

SPACES = ("2d", "planar", "3d")
REAL = (
    "mrclam_1", "mrclam_6", "mrclam_7", "mrclam_9", "mrclam5a.pyfg", "plaza2.pyfg", "parking-garage.g2o",
    "distributed_mapper_4robots", "islsjf_535",
)  # fmt: skip


def planted(log: Dataset, source: str, change: Callable[[Table], Array]) -> Dataset:
    """A log with other values in the tables of a source."""
    return log.with_tables(
        replace(table, values=change(table)) if table.source == source else table for table in log.tables
    )


def longer(factor: float) -> Callable[[Table], Array]:
    """All lengths of a table in another unit."""
    return lambda t: t.values * np.where(np.arange(t.values.shape[1]) < t.dim, factor, 1.0)


def turned_in_degrees(table: Table) -> Array:
    """What is read where headings are written in degrees."""
    steps = pose_of(table.values, 2).xytheta()
    steps[:, 2] = np.degrees(steps[:, 2])
    return pack(Pose.from_xytheta(steps))


@pytest.mark.parametrize("name", REAL)
def test_real_logs_have_none(data: Callable[[str], Path], name: str) -> None:
    """No sensor of theirs was written in another unit, and no row twice."""
    assert list(oddities(ts.read(data(name)))) == []


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_simulated_logs_have_none(space: str, seed: int) -> None:
    """Nor do made-up worlds."""
    assert list(oddities(simulate(Options(space=space, robots=2), seed))) == []


@pytest.mark.parametrize(
    ("space", "length"),
    thinned(
        3,
        SPACES,
        [
            ("odometry", "odometry", "millimetres", 1e3),
            ("odometry", "odometry", "feet", 1.0 / 0.3048),
            ("landmarks", "sightings of landmarks", "millimetres", 1e3),
        ],
    ),
)
def test_lengths_in_another_unit_are_told(space: str, length: tuple[str, str, str, float]) -> None:
    source, called, unit, factor = length
    """Of all robots that hold them, and of the right sensor."""
    log = planted(simulate(Options(space=space, robots=2), 6), source, longer(factor))
    (found,) = oddities(log)
    assert f"all robots, {called}: lengths are in {unit}" in found and "expected metres" in found


MISTAKES = {
    "odometry in millimetres": ("odometry", faults.longer(1e3), "odometry: lengths are in millimetres"),
    "millimetres": ("landmarks", faults.longer(1e3), "sightings of landmarks: lengths are in millimetres"),
    "degrees": ("landmarks", faults.degrees, "sightings of landmarks: angles are in degrees"),
    "mirrored": ("landmarks", faults.negated_angle, "sightings of landmarks: bearings have the wrong sign"),
    "robots mirrored": ("robots", faults.negated_angle, "sightings of robots: bearings have the wrong sign"),
}


@pytest.mark.parametrize(("name", "mistake"), thinned(4, ["mrclam_9", "mrclam_1", "mrclam_6", "mrclam_7"], [*MISTAKES]))
def test_mistakes_in_real_logs_are_told(data: Callable[[str], Path], name: str, mistake: str) -> None:
    """Lengths and angles in other units, bearings the other way round, in sightings of landmarks, of robots, and in
    odometry: of all robots, though bearings of some sets are loose."""
    source, change, words = MISTAKES[mistake]
    found = list(oddities(faults.plant(ts.read(data(name)), change, source=source)))
    assert found or (name, source) == ("mrclam_1", "robots")  # whose robots hardly met in any stretch
    assert all("it looks like this" in text and words in text for text in found)


def test_turns_in_degrees_are_told() -> None:
    """Though only their remainder by whole turns is left."""
    (found,) = oddities(planted(simulate(Options(space="2d", robots=2), 7), "odometry", turned_in_degrees))
    assert "all robots, odometry: turns are in degrees" in found


def test_landmarks_whose_names_are_one_number() -> None:
    """`1.0` beside `1`."""
    log = simulate(Options(space="2d", robots=2), 8)
    a, b = log.landmark_keys[:2].tolist()
    found = list(oddities(replace(log, names=Names(landmarks={a: "1", b: "1.0"}, tick_s=log.names.tick_s))))
    assert found[0].startswith("landmarks '1' and '1.0' are one number")


def renamed(log: Dataset, names: dict[int, str], robots: dict[int, str] | None = None) -> Dataset:
    """The log with landmarks, and robots, that are called otherwise."""
    return replace(log, names=Names(robots=robots or {}, landmarks=names, tick_s=log.names.tick_s))


def apart(log: Dataset) -> tuple[Dataset, int, int]:
    """The log without what robot 2 saw of one landmark and robot 1 of another, and which those are."""
    a, b = log.landmark_keys[:2].tolist()
    missed = {1: b, 2: a}
    tables = [t.select(t.keys[:, -1] != missed[t.robot]) for t in log.tables]
    return log.with_tables(tables), a, b


@pytest.mark.parametrize("pair", [("Door 1", "door_1"), ("tag 07", "Tag-7"), ("lift", "LIFT ")])
def test_landmarks_whose_names_look_alike(pair: tuple[str, str]) -> None:
    """As two robots write one name. Of one robot that has both they are two things."""
    whole = simulate(Options(space="2d", robots=2), 8)
    log, a, b = apart(whole)
    (found,) = oddities(renamed(log, {a: pair[0], b: pair[1]}))
    assert f"'{pair[0]}' (robot 1)" in found and f"'{pair[1]}' (robot 2)" in found
    assert not [*oddities(renamed(whole, {a: pair[0], b: pair[1]}))]


def test_names_that_differ_in_a_number_are_no_twins() -> None:
    """Or in a letter."""
    log, a, b = apart(simulate(Options(space="2d", robots=2), 8))
    for one, other in (("tag 1", "tag 10"), ("tag 100", "tag 1"), ("door", "doors"), ("A-1-2", "A-12")):
        assert not [*oddities(renamed(log, {a: one, b: other}))]


def test_a_robot_in_the_column_of_landmarks() -> None:
    """It is told where to write these rows; a number that a robot and a landmark have is no such slip."""
    log = simulate(Options(space="2d", robots=2), 8)
    a = int(log.landmark_keys[0])
    (found,) = oddities(renamed(log, {a: "Red"}, {1: "red", 2: "blue"}))
    assert "landmark Red is called as robots are" in found and "`other`" in found
    assert not [said for said in oddities(renamed(log, {a: "1"})) if "as robots are" in said]


def test_ranges_at_the_limit_of_their_sensor() -> None:
    """What is farther is reported as far as it sees; ranges that are counted in steps are no such slip."""
    log = simulate(Options(space="2d", robots=2), 8)

    def as_ranges(change: Callable[[Array], Array]) -> list[str]:
        seen = [t for t in log.tables if t.source == "landmarks"]
        far = [change(np.linalg.norm(t.values, axis=-1))[:, None] for t in seen]
        sigma = np.full((1, 1, 1), 10.0)
        ranged = [replace(t, model="range", values=r, whitening=sigma) for t, r in zip(seen, far, strict=True)]
        others = [t for t in log.tables if t.source != "landmarks"]
        return [said for said in oddities(log.with_tables([*others, *ranged])) if "to the last digit" in said]

    limit = float(np.median(np.linalg.norm(log.tables[1].values, axis=-1)))
    found = as_ranges(lambda far: np.minimum(far, limit))
    assert len(found) == 2 and all(f"are {limit:.6g} m" in said for said in found)
    assert not as_ranges(lambda far: far)
    assert not as_ranges(lambda far: np.ceil(far / 0.25) * 0.25)


def test_rows_in_two_logs() -> None:
    """A file under two names, and one robot's file given to another."""
    log = simulate(Options(space="2d", robots=2), 9)
    seen = next(t for t in log.tables if t.robot == 1 and t.source == "landmarks")
    twice = list(oddities(log.with_tables([*log.tables, replace(seen, source="camera")])))
    assert f"robot 1: {len(seen)} rows stand in the log of 'landmarks' and of 'camera' twice" in twice[0]
    keys = np.where(is_landmark(seen.keys), seen.keys, pose_key(2, index_of(seen.keys)))
    others = [t for t in log.tables if (t.robot, t.source) != (2, "landmarks")]
    given = list(oddities(log.with_tables([*others, replace(seen, robot=2, keys=keys)])))
    assert any("robots 1 and 2" in text and "given to two robots" in text for text in given)


def test_a_truth_at_other_times() -> None:
    """It knows the robot, and none of its poses."""
    log = simulate(Options(space="2d", robots=2), 10)
    assert log.truth is not None
    parts = []
    for kind, keys, values in log.truth.parts():
        late = (keys >= 0) & ~is_landmark(keys) & (robot_of(keys) == 1)
        parts.append(Values.of({kind: (np.where(late, keys + 1_000_000_000, keys), values)}))
    truth = parts[0] if len(parts) == 1 else parts[0].update(parts[1])
    found = list(oddities(replace(log, truth=truth)))
    assert len(found) == 1 and "robot 1: the truth lies at" in found[0] and "cannot be scored" in found[0]


@pytest.mark.parametrize(("times", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds")])
def test_stamps_of_one_robot_in_other_seconds(times: float, unit: str) -> None:
    """And none where a robot writes a thousand times as often, or stays a thousand times as long."""
    log = simulate("2d", 4)

    def faster(table: Table) -> Table:
        keys = np.where(
            is_pose(table.keys) & (robot_of(table.keys) == 2), pose_key(2, (times * index_of(table.keys)).astype(int)),
            table.keys,
        )  # fmt: skip
        return replace(table, keys=keys)

    (told,) = (said for said in oddities(log.with_tables(map(faster, log.tables))) if unit in said)
    assert told.startswith("robot 2: its way lasts ") and "expected seconds" in told
    often = [t for t in log.tables if t.robot != 2]
    few = [t.select(t.keys[:, 1] < pose_key(2, 10**7)) for t in log.tables if t.robot == 2 and t.is_odometry]
    assert not any(unit in said for said in oddities(log.with_tables([*often, *few])))
