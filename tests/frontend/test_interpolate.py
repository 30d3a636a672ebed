"""Poses between stamps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies import random_poses
from teamslam.frontend.interpolate import interpolate, on_a_smooth_way
from teamslam.frontend.stamps import keyframe_of, merge
from teamslam.geometry import Pose


@pytest.mark.parametrize("dim", [2, 3])
@given(st.integers(0, 10_000))
def test_samples_come_back_and_time_runs_evenly_between(dim: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.integers(2, 100, 6))
    poses = random_poses(rng, dim, 6)
    at_samples, good = interpolate(stamps, poses, stamps, 1000)
    assert good.all() and np.abs(at_samples.minus(poses)).max() < 1e-12
    middle, good = interpolate(stamps * 2, poses, stamps[:-1] + stamps[1:], 1000)
    before, after = middle.minus(poses[np.arange(5)]), poses[np.arange(1, 6)].minus(middle)
    assert good.all() and np.allclose(before, after, atol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
@given(st.integers(0, 10_000))
def test_a_smooth_way_is_exact_to_the_third_degree(dim: int, seed: int) -> None:
    """Places and the angle about one axis are cubics of time; samples come as they come."""
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.integers(20, 60, 8))
    n = dim if dim == 3 else 2
    places, angle, axis = rng.normal(size=(n, 4)), rng.normal(size=4), rng.normal(size=3)
    axis = axis / np.linalg.norm(axis) if dim == 3 else np.ones(1)

    def way(ticks):
        t = ticks / 400.0
        place = np.stack([np.polyval(c, t) for c in places], -1)
        return Pose.from_tangent(np.concatenate([place, 0.3 * np.polyval(angle, t)[:, None] * axis], -1), dim)

    at = np.arange(stamps[1], stamps[-2] + 1)
    found, good = on_a_smooth_way(stamps, way(stamps), at, 100)
    assert good.all() and np.abs(found.minus(way(at))).max() < 1e-9
    straight, _ = interpolate(stamps, way(stamps), at, 100)
    ends = np.r_[stamps[0] : stamps[1], stamps[-2] + 1 : stamps[-1] + 1]
    here, there = (f(stamps, way(stamps), ends, 100)[0] for f in (on_a_smooth_way, interpolate))
    assert np.abs(here.minus(there)).max() < 1e-12  # one side is missing: straight
    assert np.abs(straight.minus(way(at))).max() > 1e-9


def test_a_smooth_way_has_the_holes_and_ends_of_a_straight_one() -> None:
    stamps, poses = (
        np.array([10, 20, 30, 100, 110, 120, 130]),
        Pose.from_xytheta(np.random.default_rng(0).normal(size=(7, 3))),
    )
    at = np.arange(5, 135)
    one, other = (f(stamps, poses, at, 50) for f in (on_a_smooth_way, interpolate))
    np.testing.assert_array_equal(one[1], other[1])
    assert np.isfinite(one[0].translation).all()
    same = np.abs(one[0].minus(other[0])).max(1) < 1e-12
    assert same[np.isin(at, stamps)].all() and same[at < 110].all()


def test_headings_wrap() -> None:
    poses = Pose.from_xytheta(np.array([[0, 0, 3.0], [0, 0, -3.0]]))
    found, _ = interpolate(np.array([0, 10]), poses, np.array([5]), 100)
    assert np.isclose(abs(found.heading[0]), np.pi)


def test_holes_and_ends_are_told() -> None:
    stamps, poses = np.array([10, 20, 100]), Pose.identity(2, (3,))
    _, good = interpolate(stamps, poses, np.array([9, 10, 15, 20, 50, 100, 101]), 50)
    assert good.tolist() == [False, True, True, True, False, True, False]
    _, good = interpolate(stamps[:0], poses[np.arange(0)], np.array([1, 2]), 50)
    assert not good.any()


@given(st.lists(st.integers(0, 200), min_size=1), st.integers(0, 50))
def test_groups_of_stamps_are_short_and_apart(stamps: list[int], longest: int) -> None:
    ticks = np.array(stamps)
    keyframes = merge(ticks, longest)
    assert (np.diff(keyframes) > longest).all()
    assert ((ticks - keyframe_of(keyframes, ticks) >= 0) & (ticks - keyframe_of(keyframes, ticks) <= longest)).all()
