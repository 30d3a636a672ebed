"""Four corners give their pose back; of two that fit alike, both are told."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from teamslam.geometry import Pose, s2
from teamslam.geometry.resection import nearest, resect, slopes

TAG = 0.075 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
EVERY = 1e-3 * np.eye(8)[None] * 1e6


def facing(rng, count, near=0.3, far=4.0, lean=1.2):
    """Poses of tags whose fronts (z) are turned to the camera, in all directions about it."""
    sight = s2.of(rng.normal(size=(count, 3)))
    away = rng.uniform(near, far, (count, 1)) * sight
    back = Rotation.align_vectors
    turns = np.stack([back([-d], [[0, 0, 1]])[0].as_matrix() for d in sight])
    twist = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, (count, 1)) * [0, 0, 1]).as_matrix()
    axis = rng.normal(size=(count, 3)) * [1, 1, 0]
    axis *= rng.uniform(0, lean, (count, 1)) / np.linalg.norm(axis, axis=1, keepdims=True)
    return Pose(turns @ Rotation.from_rotvec(axis).as_matrix() @ twist, away)


def rays_to(poses, points):
    return s2.of(points @ np.swapaxes(poses.rotation, -1, -2) + poses.translation[:, None])


def test_the_pose_comes_back_in_all_directions_and_on_any_face_of_a_body():
    rng = np.random.default_rng(0)
    poses = facing(rng, 300)
    face = Pose(Rotation.random(300, random_state=1).as_matrix(), rng.normal(size=(300, 3)))
    points = TAG @ np.swapaxes(face.rotation, -1, -2) + face.translation[:, None]
    found = resect(rays_to(poses @ face.inverse(), points), points, EVERY)
    off = found.poses[:, 0].minus(poses @ face.inverse())
    assert np.abs(off).max() < 1e-6
    assert found.costs[:, 0].max() < 1e-12


def test_the_optimum_is_that_of_scipy():
    rng = np.random.default_rng(1)
    poses, sigma = facing(rng, 12, near=0.5, far=1.0), 1e-3
    points = np.broadcast_to(TAG, (12, 4, 3))
    rays = rays_to(poses, points)
    rays = s2.of(rays + (s2.direction_basis(rays) @ rng.normal(scale=sigma, size=(12, 4, 2, 1)))[..., 0])
    found = resect(rays, points, np.eye(8)[None] / sigma)
    for k in range(12):

        def error(x, k=k):
            moved = found.poses[k, 0].retract(x)
            return s2.minus(rays[k], s2.of(moved.act(TAG))).ravel() / sigma

        best = least_squares(error, np.zeros(6), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert 2 * best.cost >= found.costs[k, 0] * (1 - 1e-6) - 1e-9
        # One sigma of the pose is where the cost has risen by one.
        J = np.eye(8)[None] / sigma @ slopes(found.poses[:, 0], rays, points)[1]
        np.testing.assert_allclose(
            J[k].T @ J[k], best.jac.T @ best.jac, rtol=0.02, atol=0.02 * np.abs(J[k].T @ J[k]).max()
        )


def test_a_small_tag_far_away_has_two_poses_and_the_true_one_is_among_them():
    rng = np.random.default_rng(2)
    poses, sigma = facing(rng, 200, near=3.0, far=4.0, lean=0.7), 3e-4
    points = np.broadcast_to(TAG, (200, 4, 3))
    rays = rays_to(poses, points)
    rays = s2.of(rays + (s2.direction_basis(rays) @ rng.normal(scale=sigma, size=(200, 4, 2, 1)))[..., 0])
    found = resect(rays, points, np.eye(8)[None] / sigma)
    turned = [np.linalg.norm(found.poses[:, k].minus(poses)[:, 3:], axis=1) for k in (0, 1)]
    wrong = turned[0] > turned[1]
    assert 0.1 < wrong.mean() < 0.6  # which of them it is, cannot be told
    assert np.isfinite(found.costs[wrong, 1]).all()
    assert np.median(np.minimum(*turned)) < 0.25


@pytest.mark.parametrize("damage", ["one ray for all", "points in line", "zeros"])
def test_nonsense_gives_numbers_and_no_warning(damage):
    rng = np.random.default_rng(3)
    poses = facing(rng, 5)
    points = np.broadcast_to(TAG, (5, 4, 3)).copy()
    rays = rays_to(poses, points)
    if damage == "one ray for all":
        rays[:] = rays[:, :1]
    elif damage == "points in line":
        points[..., 1] = 0.0
    else:
        points[:] = 0.0
    found = resect(rays, points, EVERY)
    assert found.poses.translation.shape == (5, 2, 3)


def test_a_pose_nearby_leads_to_that_which_fits_best():
    rng = np.random.default_rng(2)
    poses, sigma = facing(rng, 50, near=0.5, far=2.0), 1e-3
    points = TAG + np.array([0.2, -0.1, 0.4])  # on a body whose origin is elsewhere
    rays = rays_to(poses, points)
    rays = s2.of(rays + (s2.direction_basis(rays) @ rng.normal(scale=sigma, size=(50, 4, 2, 1)))[..., 0])
    points = np.broadcast_to(points, (50, 4, 3))
    white = np.eye(8)[None] / sigma
    best = resect(rays, points, white)
    found = nearest(best.poses[:, 0].retract(rng.normal(scale=1e-3, size=(50, 6))), rays, points, white)
    costs = np.sum((slopes(found, rays, points)[0] / sigma) ** 2, -1)
    assert (costs <= best.costs[:, 0] + 1e-3).all()  # where a pose is poorly known, so little is far
    assert np.median(np.abs(found.minus(best.poses[:, 0])).max(-1)) < 1e-8
