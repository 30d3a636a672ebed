"""Images of depth say in which plane a tag lies, and how well they know it."""

from functools import cache

import numpy as np
import pytest

from frontend.tags.test_rows import scene, seen_in
from teamslam.frontend.tags.depth import SIDE, TagDepths, depths_on, planes, points_on
from teamslam.frontend.tags.late import Motion, points_at_one_instant
from teamslam.frontend.tags.plane_rows import plane_rows, standing_in
from teamslam.frontend.tags.rows import LOOKING, Tag, corner_rows
from teamslam.geometry import Pose
from teamslam.sim.film.ranging import Ranger, ranged
from teamslam.sim.film.takes import KINECT

CAMERA = KINECT


def true_planes(poses):
    """m with m . P = 1 on each tag."""
    n = poses.rotation[..., 2]
    return n / np.sum(n * poses.translation, -1, keepdims=True)


@cache
def slopes():
    """X/Z, Y/Z and 1 of all pixels (h, w, 3)."""
    width, height = CAMERA.size
    rays, good = CAMERA.rays(np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float))
    assert good.all()
    return rays / rays[..., 2:]


def image_of(plane):
    """The depths of a plane that fills the image (h, w) [m]."""
    return 1.0 / np.maximum(slopes() @ plane, 1e-3)


def large(count, seed=0):
    """Tags that are no smaller than some 20 pixels, and their corners."""
    poses, pixels = scene(CAMERA, np.random.default_rng(seed), 4 * count)
    edge = np.linalg.norm(np.roll(pixels, -1, 1) - pixels, axis=-1).min(1)
    kept = np.flatnonzero((edge > 20) & (true_planes(poses) @ [0, 0, 1.0] > 0.05))[:count]
    return poses[kept], pixels[kept]


def test_a_plane_without_noise_is_found_to_the_last_pixel():
    poses, pixels = large(8)
    for true, corners in zip(true_planes(poses), pixels, strict=True):
        m, _, good = planes_by(depths_on(image_of(true), corners[None]))
        assert good.all()
        np.testing.assert_allclose(m[0], true, atol=1e-5)  # pixels of a cell stand for their middle


def planes_by(seen, floor=0.0):
    return planes(seen, *points_on(seen, CAMERA), floor)


def measured(count, sensor, seed=0):
    poses, pixels = large(count, seed)
    parts = []
    for k, m in enumerate(true_planes(poses)):
        depths = ranged(image_of(m), sensor, np.random.default_rng([seed, k]))
        parts.append(depths_on(1e-3 * depths, pixels[k : k + 1]))
    return poses, pixels, TagDepths.together(parts)


@pytest.mark.parametrize("window", [0.3, 1.2])
def test_planes_err_as_they_say(window):
    """Whatever neighbouring pixels have in common; holes are no depths."""
    poses, _, found = measured(60, Ranger(window_px=window, lost=0.05))
    alone = {0.3: 1.0, 1.2: 4.0 * np.pi * 1.2**2}[window]  # the integral of a Gaussian filter's correlation
    assert 0.7 * alone < found.grain < 1.2 * alone
    m, covariance, good = planes_by(found)
    assert good.mean() > 0.9
    white = np.linalg.solve(np.linalg.cholesky(covariance[good]), (m - true_planes(poses))[good, :, None])
    assert 0.75 < np.mean(white**2) < 1.35


def test_a_few_wild_pixels_change_nothing():
    poses, pixels, found = measured(6, Ranger())
    wild = []
    for k, m in enumerate(true_planes(poses)):
        depths = 1e-3 * ranged(image_of(m), Ranger(), np.random.default_rng([0, k]))
        rng = np.random.default_rng(k)
        for value in (0.0, np.nan, np.inf, -1.0, 9.0):
            depths[rng.random(depths.shape) < 0.03] = value
        wild.append(depths_on(depths, pixels[k : k + 1]))
    one, other = (planes_by(seen) for seen in (found, TagDepths.together(wild)))
    off = np.linalg.solve(np.linalg.cholesky(one[1]), (other[0] - one[0])[..., None])
    assert other[2].all() and np.abs(off).max() < 2.5


@pytest.mark.parametrize("depth", [0.0, np.nan])
def test_nothing_measured_says_nothing(depth):
    _, pixels = large(2)
    found = depths_on(np.full(CAMERA.size[::-1], depth), pixels)
    assert not found.told.any() and not planes_by(found.with_grain(), 0.01)[2].any()


def test_tags_at_the_border_and_corners_in_a_line_say_nothing():
    depths = np.ones(CAMERA.size[::-1])
    outside = np.array([[[-90, -90], [-60, -90], [-60, -60], [-90, -60.0]]])
    flat = np.array([[[10, 10], [40, 10], [70, 10], [90, 10.0]]])
    for corners in (outside, flat):
        assert not depths_on(depths, corners).told.any()


def test_the_floor_is_a_share_of_the_distance():
    _, _, found = measured(5, Ranger())
    (m, one, _), (_, other, _) = (planes_by(found, floor) for floor in (0.0, 0.02))
    away = 1.0 / np.linalg.norm(m, axis=-1)
    n = m * away[:, None]
    more = np.einsum("mi,mij,mj->m", n, other - one, n)  # of 1/distance
    np.testing.assert_allclose(np.sqrt(more) * away, 0.02, rtol=1e-9)


# --- rows ---------------------------------------------------------------------------------------------------------


def rows_of(poses, pixels, m, seat=None):
    """Rows of planes m of tags that are where they are said to be."""
    tags = [Tag(k, 0.15, str(k), pose=seat) for k in range(len(poses))]
    values, white, good = corner_rows(seen_in(pixels), CAMERA, tags, 0.3, 0.3)
    assert good.all()
    noise = np.tile(np.diag(SIGMAS) ** 2, (len(m), 1, 1))
    m = m @ LOOKING.rotation
    return plane_rows(standing_in((values, white), m, tags), (m, noise), tags)


SIGMAS = np.array([0.01, 0.02, 0.03])
SEAT = Pose.from_tangent(np.array([0.1, -0.2, 0.05, 0.4, -0.3, 1.0]), 3)


def test_a_row_at_the_truth_says_nothing_else():
    poses, pixels = large(20)
    z, W, good = rows_of(poses, pixels, true_planes(poses), seat=SEAT)
    assert good.all() and (W[:, 3:] == 0.0).all() and (W[:, :3] != 0.0).any(-1).all()
    body = LOOKING.inverse()[None] @ poses @ SEAT.inverse()[None]
    np.testing.assert_allclose(z[:, :3], body.translation, atol=1e-6)
    np.testing.assert_allclose(z[:, 3:].reshape(-1, 3, 3), body.rotation, atol=1e-6)


def test_a_row_is_the_difference_of_planes_to_first_order():
    """In sigmas of the plane; along the plane and about its normal it says nothing."""
    poses, pixels = large(20)
    z, W, _ = rows_of(poses, pixels, true_planes(poses), seat=SEAT)
    at = Pose(z[:, 3:].reshape(-1, 3, 3), z[:, :3])
    tags, rng = at @ SEAT[None], np.random.default_rng(3)
    off = []
    for size in (1e-3, 1e-4):
        moved = tags.retract(size * rng.normal(size=(20, 6)))
        said = W @ at.minus(moved @ SEAT.inverse()[None])[..., None]
        true = (true_planes(tags) - true_planes(moved)) / SIGMAS
        off.append(np.abs(said[:, :3, 0] - true).max())
    assert off[1] < off[0] / 50.0
    for along in ([0.3, -0.2, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1e-5]):
        same = tags @ Pose.from_tangent(np.array(along), 3)[None] @ SEAT.inverse()[None]
        assert np.abs(W @ at.minus(same)[..., None]).max() < 1e-6


def test_of_two_poses_that_corners_tell_the_one_in_the_plane_is_taken():
    """A tag seen from far stands for two poses; noise of corners may favour the wrong one."""
    rng, taken = np.random.default_rng(0), []
    poses, pixels = large(60)
    pixels = pixels + 0.5 * rng.normal(size=pixels.shape)
    z, _, good = rows_of(poses, pixels, true_planes(poses))
    normal = (LOOKING.rotation @ z[:, 3:].reshape(-1, 3, 3))[..., 2]
    np.testing.assert_allclose(np.sum(normal * poses.rotation[..., 2], -1)[good], 1.0, atol=1e-9)
    off = Pose(LOOKING.rotation @ z[:, 3:].reshape(-1, 3, 3), z[:, :3] @ LOOKING.rotation.T).minus(poses)
    taken = np.linalg.norm(off[good, 3:], axis=-1)
    assert good.all() and taken.max() < 0.15


def test_points_that_were_measured_late_are_put_back():
    """Eye and tag move between the keyframe and each line; where tags stood need not be known of those that stay."""
    rng, (poses, _) = np.random.default_rng(4), large(20)
    eye, body = (Pose.from_tangent(0.03 * rng.normal(size=(20, SIDE**2, 6)), 3) for _ in range(2))
    points = np.concatenate([0.1 * rng.normal(size=(20, SIDE**2, 2)), np.zeros((20, SIDE**2, 1))], -1)
    there = eye.unact(poses[:, None].act(body.act(points)))
    np.testing.assert_allclose(
        points_at_one_instant(there, Motion(eye, body), poses), poses[:, None].act(points), atol=1e-12
    )
    still = Motion(eye, Pose.identity(3, body.batch))
    seen = eye.unact(poses[:, None].act(points))
    one, other = (points_at_one_instant(seen, still, where) for where in (poses, poses[::-1]))
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_plane_that_the_line_of_sight_does_not_meet_is_no_row():
    poses, pixels = large(3)
    _, W, good = rows_of(poses, pixels, -true_planes(poses))
    assert not good.any() and np.isfinite(W).all()
