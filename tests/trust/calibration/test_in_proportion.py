"""Whatever all deviations of a log are stated times, the same noise is found; and robots at rest say nothing of it."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config
from teamslam.geometry import Array
from teamslam.joining import AtMap, full
from teamslam.joining.join.held_frame import SOURCE
from teamslam.model import Dataset, Kind, Table, Values, index_of, pack, pose_key
from teamslam.pipeline import run
from teamslam.trust.calibration.estimate import searched
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.rows import linear_at
from trust.calibration.faulty import persistent, team

PARTS: Mapping[str, Callable[[Table], Array]] = {
    "odometry": lambda table: np.full(table.whitening.shape[-1], table.is_odometry),
    "sightings": lambda table: np.full(table.whitening.shape[-1], not table.is_odometry),
    "ranges": lambda table: np.arange(table.whitening.shape[-1]) == (-1 if table.is_odometry else 0),
    "bearings": lambda table: np.arange(table.whitening.shape[-1]) == (-1 if table.is_odometry else 1),
}

NUMBER = np.zeros(1, np.int64)


def _stated(log: Dataset, times: float, what: str = "") -> Dataset:
    """The log with its deviations, or those of some parts, stated so many times as large."""

    def change(table: Table) -> Table:
        which = PARTS[what](table) if what else np.ones(table.whitening.shape[-1], bool)
        return replace(table, whitening=table.whitening / np.where(which, times, 1.0))

    return log.with_tables([change(table) for table in log.tables])


def _found(log: Dataset) -> list[Array]:
    """The deviations that are found (rows,), rms over the rows of each table."""
    search, _ = searched(linear_at(AtMap(log.tables, full(log).map)))
    return [np.sqrt(np.mean(noise.deviation**2, 0)) for noise in search.now]


def _apart(one: list[Array], other: list[Array]) -> float:
    """By how much deviations differ at most (a logarithm)."""
    return max(float(np.abs(np.log(a / b)).max()) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(
    "plant", [lambda log: log, lambda log: persistent(log, 0.9)], ids=["right", "errors that last"]
)
def test_the_same_noise_is_found_whatever_all_deviations_are_stated_by(plant: Callable[[Dataset], Dataset]) -> None:
    log = plant(team(2))
    found = {times: _found(_stated(log, times)) for times in (0.01, 0.1, 0.5, 2.0, 10.0, 100.0)}
    assert max(_apart(each, found[2.0]) for each in found.values()) < 0.1


@pytest.mark.parametrize("name", ["mrclam_6", "mrclam_7"])
def test_nor_does_that_change_what_is_found_of_real_robots(data: Callable[[str], Path], name: str) -> None:
    log = ts.read(data(name))
    as_stated = _found(log)
    assert (
        max(_apart(_found(_stated(log, times)), as_stated) for times in (2.0, 10.0)) < 0.4
    )  # a robot's own, or that of all


@pytest.mark.parametrize("what", list(PARTS))
@pytest.mark.parametrize("times", [0.1, 10.0])
def test_whatever_is_stated_wrong_is_put_right(what: str, times: float) -> None:
    log = team(2)
    truth = [
        np.broadcast_to(noise.deviation, (len(noise.table), noise.deviation.shape[-1]))
        for noise in map(Noise.stated, log.tables)
    ]
    assert _apart(_found(_stated(log, times, what)), [np.sqrt(np.mean(each**2, 0)) for each in truth]) < 0.35


def test_a_map_is_no_worse_where_all_deviations_are_ten_times_too_large() -> None:
    for seed in range(3):
        log = _stated(team(seed), 10.0)
        stated, right = (run(log, Config(calibrate=calibrate)).scores[0] for calibrate in (False, True))
        assert (right.landmark_rmse_m or 1.0) < 1.1 * (stated.landmark_rmse_m or 0.0)
        assert (right.robot_position_rmse_m or 1.0) < 1.1 * (stated.robot_position_rmse_m or 0.0)
        assert 0.8 < (right.nees_per_dof or 0.0) < 1.25


def _with_stop(log: Dataset, rng: np.random.Generator, rests: int = 240) -> Dataset:
    """The team at rest for `rests` poses in the middle of its way, as its odometry reports exactly, seeing what it saw
    when it came there again and again."""
    assert log.truth is not None
    truth = log.truth
    stop = {robot: keys[len(keys) // 2] for robot, keys in log.pose_keys.items()}
    still = {robot: pose_key(robot, index_of(key) + 1 + np.arange(rests)) for robot, key in stop.items()}

    def change(table: Table) -> Table:
        here = table.keys[:, 0] == stop[table.robot]
        rows = np.append(np.arange(len(table)), np.repeat(np.flatnonzero(here), rests))
        keys, values = table.keys[rows].copy(), table.values[rows].copy()
        keys[len(table) :, 0] = np.tile(still[table.robot], int(here.sum()))
        if table.is_odometry:
            at = int(np.flatnonzero(here)[0])
            goes_on, table_end = table.keys[at, 1], len(table)
            keys[table_end:, 1] = np.append(still[table.robot][1:], goes_on)
            values[table_end:] = [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]
            keys[at, 1] = still[table.robot][0]
            values[np.array([at, -1])] = values[np.array([-1, at])]
        else:
            errors = rng.standard_normal((len(rows) - len(table), 2)) @ np.linalg.inv(table.whitening[0])
            values[len(table) :] = table.row.plus(table.predict(truth)[rows[len(table) :]], errors, table.dim)
        whitening = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))[rows]
        return replace(table, keys=keys, values=values, whitening=whitening, ids=np.arange(len(rows)))

    places = truth.poses_of(np.repeat(np.array(list(stop.values())), rests), 2)
    known = Values.of({Kind.POSE2: (np.concatenate(list(still.values())), places)})
    return replace(log.with_tables([change(table) for table in log.tables]), truth=truth.update(known))


def test_robots_at_rest_say_nothing_of_how_they_err_under_way() -> None:
    for seed in range(3):
        log = _with_stop(team(seed), np.random.default_rng(seed))
        stated = Noise.stated(log.tables[0]).deviation[0]
        moving, found = _found(log), run(log, Config(method="full")).calibration
        assert not found or not any(s.source == "odometry" for s in found.scales), found
        assert np.allclose(moving[0], stated, rtol=0.3)


def test_where_a_map_is_chosen_to_be_is_no_measurement_and_as_exact_as_it_was_said_to_be() -> None:
    """Of a world of which only headings were measured, places are a choice. (A turn of it was said to be known 3,000
    times as well: NEES/dof 2,765.)"""
    log = _stated(team(4), 2.0)
    base = int(log.pose_keys[1][0])
    truth = log.truth
    assert truth is not None
    whitening = 1000.0 * np.eye(3)[None]
    row = Table(1, SOURCE, "pose", 2, np.array([[base]]), pack(truth.poses_of(np.array([base]), 2)), whitening, NUMBER)
    log = log.with_tables([*log.tables, row])
    search, _ = searched(linear_at(AtMap(log.tables, full(log).map)))
    for table, scales in zip(search.linear.tables, search.scales, strict=True):
        if table.source == SOURCE:
            np.testing.assert_array_equal(scales, 1.0)
        elif table.source == "landmarks":
            np.testing.assert_allclose(scales, 0.5, atol=0.1)
