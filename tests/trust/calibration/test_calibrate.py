"""Whole teams: a right model is left alone, and what is planted is found, put right, and leaves honest covariances."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.io import read
from teamslam.model import Dataset, is_landmark, is_parameter, is_pose, robot_of
from teamslam.pipeline import Result, run
from teamslam.trust.calibration import Calibration
from teamslam.trust.words import sentence
from trust.calibration.faulty import SCALE, VEER_RAD, long_steps, misstated, offset, persistent, team, veering

TEAMS = range(3)
BAND = (0.85, 1.2)  # of NEES/dof of some 800 numbers, three teams' mean: 1 +- 0.03 by chance


def _nees(results: list[Result]) -> float:
    return float(np.mean([r.scores[0].nees_per_dof or np.nan for r in results]))


def _nees_of_poses(results: list[Result]) -> float:
    consistencies = [r.scores[0].consistency for r in results]
    return float(np.mean([c.of_poses.per_dof for c in consistencies if c is not None and c.of_poses is not None]))


@pytest.mark.parametrize(("model", "space"), [("range_bearing", "2d"), ("point", "planar"), ("point", "3d")])
def test_a_right_model_is_left_alone(model: str, space: str) -> None:
    results = [run(team(50 + seed, model, space, poses=60), Config(method="full")) for seed in range(5)]
    assert sum(bool(r.calibration) for r in results) <= 1
    assert not any(r.calibration and (r.calibration.systematic or r.calibration.lasting) for r in results)


@pytest.mark.parametrize("method", ["full", "join"])
def test_an_offset_of_every_robots_ranges_is_found(method: str) -> None:
    results, off = [], []
    for seed in TEAMS:
        log, lengths = offset(team(seed), np.random.default_rng(seed))
        results.append(run(log, Config(method=method)))
        found = {
            e.robot: e
            for e in (results[-1].calibration or Calibration()).systematic
            if (e.source, e.term) == ("landmarks", "range offset")
        }
        off += [(e.value - lengths[robot]) / e.sigma for robot, e in found.items()]
    assert BAND[0] < _nees(results) < BAND[1]
    assert len(off) >= 6 and np.sqrt(np.mean(np.square(off))) < 2.0


@pytest.mark.parametrize("seed", [0, 2])
def test_a_join_put_right_is_as_sure_as_full_least_squares(seed: int) -> None:
    """What robots saw of each other travels raw, put right by errors that a join does not doubt; the map does."""
    log, _ = offset(team(seed), np.random.default_rng(seed))
    places, covariances = [], []
    for method in ("full", "join"):
        map = run(log, Config(method=method)).map
        keys = map.values.layout.keys[is_landmark(map.values.layout.keys)]
        at = map.values.layout.unknowns(keys)
        places.append(map.values.positions(keys, 2).ravel())
        covariances.append(np.linalg.inv(map.information.toarray())[np.ix_(at, at)])
    apart = places[1] - places[0]
    assert np.sqrt(apart @ np.linalg.solve(covariances[0], apart) / len(apart)) < 0.01
    assert np.trace(covariances[1]) == pytest.approx(np.trace(covariances[0]), rel=0.005)


def test_odometry_that_is_too_long_is_found() -> None:
    results = [run(long_steps(team(seed)), Config(method="full")) for seed in TEAMS]
    errors = [e for r in results for e in (r.calibration or Calibration()).systematic]
    assert {(e.source, e.term) for e in errors} == {("odometry", "scale")}
    assert np.sqrt(np.mean([((e.value - SCALE) / e.sigma) ** 2 for e in errors])) < 2.0
    assert BAND[0] < _nees(results) < BAND[1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_turns_that_nobody_stated_are_found_beside_errors_that_last(seed: int) -> None:
    log = persistent(veering(team(seed), np.random.default_rng(seed)), 0.9)
    result = run(log, Config(method="full"))
    (slip,) = (result.calibration or Calibration()).slips
    assert slip.name == "turn" and 0.5 * VEER_RAD < slip.density < 2.0 * VEER_RAD
    assert BAND[0] < (result.scores[0].nees_per_dof or np.nan) < BAND[1]


@pytest.mark.parametrize(
    "plant",
    [
        pytest.param(lambda log: misstated(log, 3.0), id="sigmas three times too large"),
        pytest.param(lambda log: misstated(log, 1.0 / 3.0), id="sigmas three times too small"),
        pytest.param(lambda log: persistent(log, 0.9), id="errors that last"),
    ],
)
def test_covariances_are_honest_again(plant: Callable[[Dataset], Dataset]) -> None:
    logs = [plant(team(seed)) for seed in TEAMS]
    before = [run(log, Config(method="full", calibrate=False)) for log in logs]
    after = [run(log, Config(method="full")) for log in logs]
    assert BAND[0] < _nees(after) < BAND[1]
    assert abs(np.log(_nees_of_poses(after))) < 0.5 * abs(np.log(_nees_of_poses(before)))


def test_where_errors_last_most_teams_are_within_their_own_band() -> None:
    results = [run(persistent(team(seed), 0.9), Config(method="full")) for seed in range(6)]
    inside = [c is not None and c.nees.inside for c in (r.scores[0].consistency for r in results)]
    assert sum(map(bool, inside)) >= 4  # 0.95 each by the model that is true; 0.16 by rows that are only tempered


@pytest.mark.parametrize("method", ["full", "join"])
def test_what_weighing_costs_rows_by_themselves_is_not_laid_to_a_join(method: str) -> None:
    """Rows of errors that last count for less, so each alone could be met better, by any method."""
    said = sentence(run(persistent(team(2), 0.9), Config(method=method)).verdict)
    assert "since rows count by how their errors hang together" in said and "join" not in said


def test_a_few_real_robots_make_no_map_of_another_size(data: Callable[[str], Path]) -> None:
    """Three robots of MRCLAM 6: what the scales of their ranges have in common is not odometry's error."""
    part = _of_few(read(data("mrclam_6")), (1, 2, 3))
    stated, right = (run(part, Config(calibrate=calibrate)).scores[0] for calibrate in (False, True))
    assert (right.landmark_rmse_m or 1.0) < 0.5 * (stated.landmark_rmse_m or 0.0)


@pytest.mark.parametrize("robots", [(2, 5), (2, 4, 5)])
def test_what_a_map_carries_makes_no_information_that_nothing_has(
    data: Callable[[str], Path], robots: tuple[int, ...]
) -> None:
    """Errors that fade move a map of few robots far once how rows differ is known: its information is that of one
    place still, and positive definite."""
    (one,) = run(_of_few(read(data("mrclam_6")), robots), Config(method="full")).maps
    assert is_parameter(one.values.layout.keys).any()
    assert np.linalg.eigvalsh(one.information.toarray())[0] > 0.0


def _of_few(log: Dataset, robots: tuple[int, ...]) -> Dataset:
    """What some robots measured of each other and of landmarks."""
    tables = [table for table in log.tables if table.robot in robots]
    few = [np.isin(robot_of(table.keys), robots) | ~is_pose(table.keys) for table in tables]
    return log.with_tables(table.select(rows.all(-1)) for table, rows in zip(tables, few, strict=True))
