"""Poses between stamps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies import random_poses
from teamslam.frontend.interpolate import interpolate
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
