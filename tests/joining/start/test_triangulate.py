"""Landmarks seen only by bearings or ranges: placed where the geometry fixes them, left out where it does not."""

import numpy as np
import pytest

from teamslam.joining import build, full, join, split
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import is_landmark, is_pose
from worlds import team


@pytest.mark.parametrize("model", ["bearing", "range"])
def test_noise_free_sightings_give_the_landmark(model: str) -> None:
    dataset = team("2d", robots=1, poses=15, model=model, sigma=1e-9, sigma_odometry=1e-9)
    assert dataset.truth is not None
    poses = dataset.truth.select(is_pose(dataset.truth.layout.keys))
    found = triangulate(poses, dataset.tables)
    assert found.layout.contains(dataset.landmark_keys).all()
    apart = found.positions(dataset.landmark_keys, 2) - dataset.truth.positions(dataset.landmark_keys, 2)
    np.testing.assert_allclose(apart, 0.0, atol=1e-5)


@pytest.mark.parametrize("model", ["bearing", "range"])
def test_a_robot_with_a_poor_sensor_still_maps(model: str) -> None:
    dataset = team("2d", robots=2, poses=20, model=model, sigma=0.01, sigma_odometry=0.01)
    assert dataset.truth is not None
    joined = join(build(piece) for piece in split(dataset))
    baseline = full(dataset, initial=joined)
    truth = dataset.truth.transform(dataset.truth.pose(joined.map.base).inverse())
    assert len(joined.components) == 1
    assert is_landmark(joined.map.values.layout.keys).sum() == len(dataset.landmark_keys)
    for map_ in (joined.map, baseline.map):
        assert np.abs(map_.values.minus(truth.only(map_.values.layout.keys))).max() < 0.5


def test_one_bearing_leaves_a_landmark_out() -> None:
    dataset = team("2d", robots=1, poses=10, model="bearing")
    odometry, sightings = dataset.tables
    mark = sightings.keys[0, 1]
    once = sightings.select(np.flatnonzero(sightings.keys[:, 1] == mark)[:1])
    assert dataset.truth is not None
    poses = dataset.truth.select(is_pose(dataset.truth.layout.keys))
    assert not triangulate(poses, [odometry, once]).layout.contains(mark)
