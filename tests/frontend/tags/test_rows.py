"""Corners in an image become rows whose residual at the truth is their noise, in sigmas."""

import numpy as np
import pytest

from frontend.tags.test_camera import CAMERAS
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.noise import corner_sigmas
from teamslam.frontend.tags.rows import LOOKING, SQUARE, Tag, corner_rows
from teamslam.geometry import Pose, concatenate, s2
from teamslam.model import Kind, Table, Values, landmark_key, pose_key


def scene(camera, rng, count):
    """Tags before a camera, and where their corners appear."""
    turn = Pose.from_tangent(np.concatenate([np.zeros((count, 3)), rng.uniform(-0.7, 0.7, (count, 3))], 1), 3)
    facing = Pose(np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (count, 3, 3)), np.zeros((count, 3)))  # read upright
    centre = camera.rays(rng.uniform(0.3, 0.7, (count, 2)) * camera.size)[0] * rng.uniform(0.5, 3.0, (count, 1))
    poses = Pose(turn.rotation @ facing.rotation, centre)
    corners = 0.15 * SQUARE @ np.swapaxes(poses.rotation, -1, -2) + poses.translation[:, None]
    return poses, camera.project(corners)


def seen_in(pixels):
    m = len(pixels)
    return TagCorners(np.arange(m), np.arange(m), np.arange(m), pixels, np.zeros(m, np.int64), ("",) * m)


@pytest.mark.parametrize("name", CAMERAS)
def test_residuals_at_the_truth_are_the_noise_in_sigmas(name):
    rng, camera, m = np.random.default_rng(0), CAMERAS[name], 300
    poses, pixels = scene(camera, rng, m)
    sigmas = corner_sigmas(pixels, 0.3, 0.4)
    noise = rng.normal(size=pixels.shape)
    tags = [Tag(k, 0.15, str(k)) for k in range(m)]
    values, white, good = corner_rows(seen_in(pixels + noise * sigmas[..., None]), camera, tags, 0.3, 0.4)
    assert good.all()
    body = Pose.from_tangent(np.array([1.0, 2.0, 0.3, 0.1, -0.4, 2.0]), 3)
    mount = Pose.from_tangent(np.array([0.1, 0.0, 0.3, -1.2, 0.3, -1.1]), 3)
    keys = np.stack([np.full(m, pose_key(1, 0)), landmark_key(np.arange(m))], -1)
    world = body @ mount
    everything = concatenate([world[None] @ poses, body[None]])
    truth = Values.of({Kind.POSE3: (np.append(landmark_key(np.arange(m)), pose_key(1, 0)), everything)})
    table = Table(1, "landmarks", "corners", 3, keys, values, white, np.arange(m), mount @ LOOKING)
    found = table.whitened(truth)
    # Sigmas follow from the corners as they were seen, which matters where a tag is nearly edge on: hence the slack.
    flat = sigmas.max(1) < 1.0
    np.testing.assert_allclose(np.sum(found**2, -1)[flat], np.sum(noise**2, (-1, -2))[flat], rtol=0.2)
    assert 0.95 < np.mean(found**2) < 1.05


def test_small_tags_and_slanted_ones_are_known_less():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    large, small = corner_sigmas(np.stack([100 * square, 10 * square]), 0.0, 0.5)
    np.testing.assert_allclose(small / large, np.sqrt(10.0))
    np.testing.assert_allclose(large, 0.5 * 2.0 / np.sqrt(100.0))
    slanted = square @ np.array([[1.0, 0.0], [0.8, 0.6]])
    assert (corner_sigmas(100 * slanted[None], 0.0, 0.5) > large[:1]).all()
    assert (corner_sigmas(1e4 * square[None], 0.3, 0.5) < 0.31).all()


def test_a_tag_on_a_body_has_its_corners_there():
    face = Pose.from_tangent(np.array([0.0, 0.07, 0.3, 0.0, 0.0, 1.0]), 3)
    tag = Tag(3, 0.12, "cube", True, face)
    np.testing.assert_allclose(tag.corners, face.act(0.12 * SQUARE))
    assert np.allclose(s2.of(tag.corners[1] - tag.corners[0]), face.rotation[:, 0])  # x of the tag runs to its right
