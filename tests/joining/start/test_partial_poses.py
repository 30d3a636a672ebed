"""Landmarks with a heading that no single sighting fixes: placed where several do, left out where they do not."""

from dataclasses import replace

import numpy as np
import pytest

import teamslam as ts
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import Dataset, Kind, Values, is_pose, landmark_key
from worlds import measure, team

MARKS = landmark_key(np.arange(3))


def blind_ahead(turns: bool) -> Dataset:
    """A robot that sees where three signs stand and how they are turned, but not how far ahead."""
    log = team("2d", robots=1, poses=6, sigma_odometry=1e-6)
    poses, truth = log.pose_keys[1], log.truth
    assert truth is not None
    signs = truth.poses_of(poses[[1, 3, 5]], 2)
    signs = replace(signs, translation=signs.translation + np.array([2.0, 1.0]))
    truth = truth.select(is_pose(truth.layout.keys)).update(Values.of({Kind.POSE2: (MARKS, signs)}))
    seers = poses if turns else poses[:1]
    pairs = np.stack([np.repeat(seers, 3), np.tile(MARKS, len(seers))], -1)
    seen = measure(1, "landmarks", "relative_pose", 2, pairs, 1e-6, truth, np.random.default_rng(0))
    seen = replace(seen, whitening=np.diag([0.0, 1e6, 1e6])[None])
    return replace(log, tables=(log.tables[0], seen), truth=truth)


def test_sightings_from_several_headings_give_the_landmark() -> None:
    log = blind_ahead(turns=True)
    assert log.truth is not None
    found = triangulate(log.truth.only(log.pose_keys[1]), log.tables)
    error = found.only(MARKS).minus(log.truth.only(MARKS))
    np.testing.assert_allclose(error, 0.0, atol=1e-4)


def test_what_all_sightings_leave_open_stays_out() -> None:
    log = blind_ahead(turns=False)
    assert log.truth is not None
    found = triangulate(log.truth.only(log.pose_keys[1]), log.tables)
    assert not found.layout.contains(MARKS).any()


@pytest.mark.parametrize("method", ["join", "full"])
def test_a_map_holds_such_landmarks(method: str) -> None:
    joined = ts.run(blind_ahead(turns=True), ts.Config(method=method)).joined
    assert joined.map.all_values.layout.contains(MARKS).all() and not joined.left_out
