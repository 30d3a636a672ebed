"""A truth is matched with a map by what people call things, and not by the numbers that two logs happened to give."""

import numpy as np
import pytest

from metrics_maps import map_of, small
from teamslam.errors import InputError
from teamslam.metrics import as_called, score
from teamslam.model import Names, index_of, is_pose, pose_key, robot_of


def test_robots_and_landmarks_are_matched_by_name() -> None:
    """The same team numbered in another order, with stamps in other ticks, has the same score."""
    log = small("2d", robots=3)
    assert log.truth is not None
    called = Names({1: "Ada", 2: "Bob", 3: "Cyd"}, {0: "door", 1: "7"}, 1e-6)
    made = map_of(log)
    made = made.__class__(**{**vars(made), "names": called} | {"raw": ()})
    keys = log.truth.layout.keys
    poses = is_pose(keys)
    theirs = keys.copy()
    theirs[poses] = pose_key(4 - robot_of(keys[poses]), index_of(keys[poses]) // 1000)
    theirs[~poses] = 100 + keys[~poses]
    names = {100 + int(k): called.landmark(int(k)) for k in keys[~poses]}
    other = log.truth.renamed(keys, theirs)
    known = as_called(other, Names({1: "Cyd", 2: "Bob", 3: "Ada"}, names, 1e-3), made)
    assert np.array_equal(known.layout.keys, log.truth.layout.keys)
    np.testing.assert_array_equal(known.state, log.truth.state)
    assert score(made, known).robot_position_rmse_m == pytest.approx(0.0, abs=1e-9)


def test_strangers_are_not_compared_by_number() -> None:
    """Robots of other names have nothing to do with ours, whatever their number."""
    log = small("2d")
    assert log.truth is not None
    robots = {int(r): f"other {r}" for r in log.robots}
    marks = {int(k): f"other {k}" for k in log.landmark_keys}
    assert len(as_called(log.truth, Names(robots, marks, 1e-6), map_of(log))) == 0


def test_counts_and_times_are_not_compared() -> None:
    log = small("2d")
    assert log.truth is not None
    with pytest.raises(InputError, match="nothing tells which pose is which"):
        as_called(log.truth, Names(tick_s=1.0), map_of(log))


def test_a_map_of_another_world_is_doubted() -> None:
    """Its errors are as large as itself; a map of this world with its errors is not doubted."""
    here, there = small("2d", seed=1), small("2d", seed=2)
    assert here.truth is not None and there.truth is not None
    assert "is this the truth of this team" in score(map_of(here), there.truth).note
    rough = 0.2 * np.random.default_rng(0).standard_normal(map_of(here).dof)
    assert score(map_of(here, rough), here.truth).note == ""
