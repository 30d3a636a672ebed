"""Why a landmark is in no map, on planted causes."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.geometry import Pose, directions
from teamslam.joining.join.why_open import FAILS, IN_PLANE, PARALLEL, SKEW, why_open
from teamslam.model import Sources, Submap, Table, Values, index_of, landmark_key, pose_key
from teamslam.model.layout import Kind

MARK = np.array([2.0, 1.0, 0.5])
SIGMA, DRIFT = 1e-3, 5e-3  # [rad] of rays, [m] of steps


def turned_on_the_spot(apart: float, seed: int) -> tuple[Table, Submap]:
    """Rays to a landmark from three poses, `apart` [m] from one to the next, and the map of these poses, which holds
    them as odometry does."""
    rng, poses = np.random.default_rng(seed), pose_key(1, np.arange(3))
    places = np.stack([apart * np.arange(3), np.zeros(3), np.zeros(3)], -1)
    rays = directions(3).plus(directions(3).of(MARK - places), rng.normal(0.0, SIGMA, (3, 2)))
    keys = np.stack([poses, np.repeat(landmark_key(4), 3)], -1)
    seen = Table(1, "landmarks", "bearing", 3, keys, rays, np.eye(2)[None] / SIGMA, np.arange(3))
    drifted = places + np.cumsum(rng.normal(0.0, DRIFT, (3, 3)), 0)
    drifted -= drifted[0]
    values = Values.of({Kind.POSE3: (poses[1:], Pose(np.tile(np.eye(3), (2, 1, 1)), drifted[1:]))})
    step = np.linalg.inv(np.diag([DRIFT**2] * 3 + [1e-8] * 3))
    information = np.block([[2.0 * step, -step], [-step, step]])
    return seen, Submap("1/0", 0, int(poses[0]), 3, values, sp.csc_array(information), Sources())


@pytest.mark.parametrize("seed", range(5))
def test_rays_from_places_that_are_no_farther_apart_than_they_are_known_leave_the_distance_open(seed: int) -> None:
    """On the spot a drift looks like a way: the rays meet somewhere, and nothing contradicts anything."""
    seen, whole = turned_on_the_spot(0.0, seed)
    assert PARALLEL in why_open(int(landmark_key(4)), [seen], [whole])


def test_rays_from_far_apart_are_no_reason() -> None:
    seen, whole = turned_on_the_spot(1.0, 0)
    assert FAILS in why_open(int(landmark_key(4)), [seen], [whole])


def test_rays_at_an_angle_that_pass_each_other_are_not_said_to_be_parallel() -> None:
    """One that is wrong by half a radian fits no place with the others, whatever its geometry leaves open."""
    seen, whole = turned_on_the_spot(1.0, 0)
    wrong = seen.values.copy()
    wrong[2:] = directions(3).plus(wrong[2:], np.array([[0.0, 0.5]]))
    assert SKEW in why_open(int(landmark_key(4)), [replace(seen, values=wrong)], [whole])


def test_of_maps_that_stand_apart_each_is_told_by_itself() -> None:
    """Two robots on two lines: together their ranges would tell, but nobody knows how the lines lie to each other."""
    (seen, whole), key = turned_on_the_spot(1.0, 0), int(landmark_key(4))
    other = replace(whole, id="2/0", base=int(pose_key(2, 0)), values=_of_robot(whole.values, 2))
    ranges = [_ranges(seen, robot) for robot in (1, 2)]
    said = why_open(key, ranges, [whole, other])
    assert said == f"6 ranges from poses of 2 maps, in each of which {IN_PLANE}"
    assert why_open(key, ranges[:1], [whole, other]) == f"3 ranges: {IN_PLANE}"


def _of_robot(values: Values, robot: int) -> Values:
    keys = values.layout.keys
    return Values.of({Kind.POSE3: (pose_key(robot, index_of(keys)), values.poses_of(keys, 3))})


def _ranges(seen: Table, robot: int) -> Table:
    keys = np.stack([pose_key(robot, index_of(seen.keys[:, 0])), seen.keys[:, 1]], -1)
    lengths = np.linalg.norm(MARK - np.stack([np.arange(3.0), np.zeros(3), np.zeros(3)], -1), axis=-1)[:, None]
    return Table(robot, "landmarks", "range", 3, keys, lengths, np.eye(1)[None] / SIGMA, np.arange(3))
