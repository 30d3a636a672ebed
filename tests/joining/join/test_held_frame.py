"""Where the world was measured in part, its rows count, and the rest is written as the first pose has it."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.config import Config, JoinOptions
from teamslam.joining import full
from teamslam.joining.join import held_frame
from teamslam.joining.join.held_frame import SOURCE, with_frame
from teamslam.model import WORLD, Dataset, Table, is_pose
from teamslam.pipeline import Result, run
from worlds import measure, team

METHODS = {
    "join": Config(calibrate=False),
    "exact": Config(join=JoinOptions(exact=True), calibrate=False),
    "full": Config(method="full", calibrate=False),
}
TOLD = {  # which numbers a sensor tells
    ("2d", "compass"): ("pose", [2]),
    ("3d", "depth"): ("position", [2]),
    ("3d", "tilt"): ("pose", [3, 4]),
    ("3d", "compass"): ("pose", [3, 4, 5]),
}


def sensed(space: str, sensor: str) -> Dataset:
    """A team whose robots all have a sensor that tells part of where they are in the world; the rest is nonsense."""
    log = team(space, robots=2, poses=30, landmarks=8, sigma_odometry=0.05)
    assert log.truth is not None
    rng = np.random.default_rng(5)
    model, told = TOLD[space, sensor]
    rows = []
    for robot, keys in log.pose_keys.items():
        row = measure(robot, sensor, model, log.robots[robot], keys[:, None], 0.005, log.truth, rng)
        own = np.zeros(row.whitening.shape[-1], bool)
        own[told] = True
        values = row.values.copy()
        if model == "position" or max(told) > log.robots[robot] - 1:
            values[:, : log.robots[robot]] = np.where(own[: log.robots[robot]], values[:, : log.robots[robot]], 1e3)
        rows.append(replace(row, values=values, whitening=row.whitening * own[:, None]))
    return log.with_tables([*log.tables, *rows])


def headings(found: Result) -> float:
    """How uncertain the last pose is, in all [the root of the covariance's trace]."""
    keys = found.map.keys[is_pose(found.map.keys)]
    return float(np.sqrt(np.trace(found.covariances[0].relative(found.map.all_values, int(keys[0]), int(keys[-1])))))


@pytest.mark.parametrize(("space", "sensor"), list(TOLD))
@pytest.mark.parametrize("method", METHODS)
def test_no_row_of_it_is_left_out_and_covariances_are_honest(space: str, sensor: str, method: str) -> None:
    log = sensed(space, sensor)
    found = run(log, METHODS[method])
    assert found.map.base == WORLD and not found.joined.left_out
    (said,) = [remark for remark in found.joined.remarks if remark.startswith("what was measured in the world")]
    assert "as robot 1 at " in said
    assert 0.6 < found.scores[0].nees_per_dof < 1.5
    without = run(log.with_tables([t for t in log.tables if t.source != sensor]), METHODS[method])
    assert headings(found) < headings(without)


@pytest.mark.parametrize(("space", "sensor"), [("2d", "compass"), ("3d", "depth")])
def test_joined_exactly_it_is_full_least_squares(space: str, sensor: str) -> None:
    exact, whole = (run(sensed(space, sensor), METHODS[name]) for name in ("exact", "full"))
    assert exact.costs[0] is not None and whole.costs[0] is not None
    assert exact.costs[0].cost == pytest.approx(whole.costs[0].cost, rel=1e-6)


def test_the_row_is_a_choice_on_which_nothing_depends(monkeypatch: pytest.MonkeyPatch) -> None:
    """However hard it holds: the cost is the same, and its own residual is zero."""
    found = []
    for sigma in (1e-3, 1e-1):
        monkeypatch.setattr(held_frame, "SIGMA", sigma)
        log, said = with_frame(log := sensed("3d", "depth"), full(log).map)
        assert said
        (row,) = [t for t in log.tables if t.source == SOURCE]
        mapped = full(log).map
        assert np.abs(row.whitened(mapped.all_values)).max() < 1e-6
        found.append(mapped)
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-9)
    apart = found[0].values.minus(found[1].values)
    assert np.abs(apart).max() < 1e-5


def test_a_world_that_is_told_whole_or_by_no_more_than_it_takes_is_left_as_it_is() -> None:
    log = team("2d", robots=1, poses=20, landmarks=6)
    assert log.truth is not None
    rng = np.random.default_rng(1)
    keys = log.pose_keys[1]
    for every in (3, len(keys)):
        row: Table = measure(1, "gps", "position", 2, keys[::every, None], 0.02, log.truth, rng)
        fixed = log.with_tables([*log.tables, row])
        assert with_frame(fixed, full(fixed).map) == (fixed, "")
