"""Rays tell of a landmark's place as far as it is known where they come from."""

import numpy as np
import pytest

from teamslam.geometry import Pose, compose_along
from teamslam.joining import build
from teamslam.model import Dataset, Kind, Names, Values, is_landmark, landmark_key, pose_key
from worlds import chain, measure

ODOMETRY, BEARING = 0.005, 0.015  # [m], [rad]
MARKS = 20


def driven(seed: int, step_m: float, poses: int = 3) -> Dataset:
    """A robot of the plane that turns as it goes, if it goes, and looks at landmarks some metres away at each pose."""
    rng = np.random.default_rng(seed)
    own, marks = pose_key(1, np.arange(poses)), landmark_key(np.arange(MARKS))
    way = compose_along(Pose.from_tangent(np.tile([step_m, 0.0, 0.5], (poses - 1, 1)), 2))
    around = rng.uniform(2.0, 5.0, (MARKS, 1)) * np.stack([np.cos(a := rng.uniform(0, 6.3, MARKS)), np.sin(a)], -1)
    truth = Values.of({Kind.POSE2: (own, way), Kind.POINT2: (marks, around)})
    pairs = np.stack([np.repeat(own, MARKS), np.tile(marks, poses)], -1)
    odometry = measure(1, "odometry", "relative_pose", 2, chain(own), ODOMETRY, truth, rng)
    bearings = measure(1, "landmarks", "bearing", 2, pairs, BEARING, truth, rng)
    return Dataset({1: 2}, (odometry, bearings), Names(tick_s=1.0), truth)


@pytest.mark.parametrize("seed", range(5))
def test_rays_from_one_place_meet_nowhere(seed: int) -> None:
    """Whatever odometry says of millimetres: the submap knows of no landmark where it is, and all rays go along with
    it."""
    log = driven(seed, 0.0)
    submap = build(log)
    assert not is_landmark(submap.keys).any()
    assert sum(len(t) for t in submap.raw) == 3 * MARKS


def test_rays_from_a_way_that_is_known_meet() -> None:
    log = driven(0, 1.0)
    known = build(log).keys
    assert np.count_nonzero(is_landmark(known)) > MARKS // 2  # the others lie along its way
