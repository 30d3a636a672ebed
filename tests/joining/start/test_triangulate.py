"""Landmarks seen only by bearings or ranges: placed where the geometry fixes them, left out where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import generators, random_poses
from teamslam.geometry import Pose
from teamslam.joining import build, full, join, split
from teamslam.joining.start.triangulate import Bundle, triangulate
from teamslam.model import MODELS, Table, Values, is_landmark, is_pose, landmark_key, pose_key, pose_kind
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


@settings(max_examples=40, deadline=None)
@given(
    generators,
    st.sampled_from([("bearing", 2, 2), ("bearing", 3, 3), ("bearing", 2, 3), ("range", 2, 2), ("range", 3, 3)]),
)
def test_sightings_of_any_dimension_give_the_landmark(rng: np.random.Generator, seen: tuple[str, int, int]) -> None:
    """By sensors of its own dimension, and by bearings in the planes of robots that are tilted every way."""
    model, sensor, dim = seen
    poses, marks = random_poses(rng, dim, 12, turn=3.0), rng.normal(scale=3.0, size=(3, dim))
    keys = np.stack([pose_key(1, np.tile(np.arange(12), 3)), landmark_key(np.repeat(np.arange(3), 12))], -1)
    row, zero = MODELS[model], np.zeros((36, MODELS[model].size[sensor - 2]))
    table = Table(
        1, "landmarks", model, sensor, keys, zero, np.eye(row.residual_rows(sensor))[None] * 1e3, np.arange(36)
    )
    values = table.predict_from(poses[np.tile(np.arange(12), 3)], np.repeat(marks, 12, 0))
    start = Values.of({pose_kind(dim): (keys[:12, 0], poses)})
    found = Bundle.of([replace(table, values=values)], start, landmark_key(np.arange(3)), dim)
    places, held = found.intersected()
    assert held.all()
    np.testing.assert_allclose(places, marks, atol=1e-5)


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


@settings(max_examples=40, deadline=None)
@given(generators, st.sampled_from([2, 3]), st.floats(0.0, 6.0), st.integers(1, 3))
def test_few_ranges_from_far_away_are_answered(rng: np.random.Generator, sensor: int, far: float, count: int) -> None:
    """Landmarks in space, from sensors a long way from the origin, of the plane or of space: some place, no error."""
    n = 60
    away = 10.0**far * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    eyes = Pose.from_tangent(rng.normal(scale=2.0, size=(n * count, 6)) + away, 3)
    keys = np.stack([pose_key(1, np.arange(n * count)), landmark_key(np.tile(np.arange(n), count))], -1)
    seen = rng.uniform(0.1, 9.0, (n * count, 1))
    table = Table(1, "landmarks", "range", sensor, keys, seen, np.ones((1, 1, 1)), np.arange(n * count))
    start = Values.of({pose_kind(3): (keys[:, 0], eyes)})
    places, _ = Bundle.of([table], start, landmark_key(np.arange(n)), 3).intersected()
    assert np.isfinite(places).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from(["bearing", "range"]), st.sampled_from([2, 3]), st.floats(-6.0, 2.0))
@settings(max_examples=25)
def test_one_sighting_that_tells_less_than_a_place_gives_none(seed: int, model: str, dim: int, power: float) -> None:
    """Of many landmarks, each seen from a pose of its own: from anywhere, in any direction, however sharply."""
    rng, n = np.random.default_rng(seed), 60
    eyes = Pose.from_tangent(rng.normal(scale=2.0, size=(n, 3 if dim == 2 else 6)), dim)
    rays = rng.normal(size=(n, dim))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    directions = np.arctan2(rays[:, 1:], rays[:, :1]) if dim == 2 else rays
    seen = rng.uniform(0.1, 9.0, (n, 1)) if model == "range" else directions
    sharp = 10.0**-power * np.eye(1 if model == "range" else dim - 1)[None]
    keys = np.stack([pose_key(1, np.arange(n)), landmark_key(np.arange(n))], -1)
    table = Table(1, "landmarks", model, dim, keys, seen, sharp, np.arange(n))
    start = Values.of({pose_kind(dim): (keys[:, 0], eyes)})
    assert not triangulate(start, [table]).layout.contains(keys[:, 1]).any()


def test_one_bearing_leaves_a_landmark_out() -> None:
    dataset = team("2d", robots=1, poses=10, model="bearing")
    odometry, sightings = dataset.tables
    mark = sightings.keys[0, 1]
    once = sightings.select(np.flatnonzero(sightings.keys[:, 1] == mark)[:1])
    assert dataset.truth is not None
    poses = dataset.truth.select(is_pose(dataset.truth.layout.keys))
    assert not triangulate(poses, [odometry, once]).layout.contains(mark)
