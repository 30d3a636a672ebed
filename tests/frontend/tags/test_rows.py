"""Corners in an image become rows whose residual at the truth is their noise, in sigmas."""

import numpy as np
import pytest

from frontend.tags.test_camera import CAMERAS
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.edges import SHARP
from teamslam.frontend.tags.noise import corner_covariances
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
    covariances = corner_covariances(pixels, 0.3, 0.3)
    noise = rng.normal(size=(m, 8))
    moved = (np.linalg.cholesky(covariances) @ noise[..., None]).reshape(pixels.shape)
    tags = [Tag(k, 0.15, str(k)) for k in range(m)]
    values, white, good = corner_rows(seen_in(pixels + moved), camera, tags, 0.3, 0.3)
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
    flat = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)).max(1) < 0.5
    np.testing.assert_allclose(np.sum(found**2, -1)[flat], np.sum(noise**2, -1)[flat], rtol=0.2)
    assert 0.95 < np.mean(found**2) < 1.05


def fitted(corners, s, rng, count):
    """Corners (count, 4, 2) where lines cross that are fitted to 16 points on each edge, each off by s across it."""
    share = (1.0 + np.arange(16)) / 17.0
    lines = []
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
        fit = np.polynomial.polynomial.polyfit(share, s * rng.normal(size=(16, count)), 1)
        ends = a + fit[0][:, None] * normal, b + fit.sum(0)[:, None] * normal
        lines.append(np.cross(*(np.concatenate([end, np.ones((count, 1))], 1) for end in ends)))
    crossings = (np.cross(before, line) for before, line in zip(np.roll(lines, 1, 0), lines, strict=True))
    return np.stack([at[:, :2] / at[:, 2:] for at in crossings], 1)


@pytest.mark.parametrize(
    "shape", [[[0, 0], [0.8, 0.6], [0.2, 1.4], [-0.6, 0.8]], [[0, 0], [1, 0.1], [1.3, 0.9], [0.2, 0.7]]]
)
def test_corners_err_as_lines_fitted_along_edges_cross(shape):
    corners = 100.0 * np.array(shape, float)
    found = fitted(corners, 0.1, np.random.default_rng(1), 20_000).reshape(-1, 8)
    assert np.allclose(found.mean(0), corners.ravel(), atol=0.01)
    stated = corner_covariances(corners[None], 0.0, 0.1, np.full((1, 4), SHARP))[0]
    apart = corner_covariances(corners[None], 0.0, 0.1)[0]  # of others' corners: the same, each by itself
    assert np.allclose(apart, stated * np.kron(np.eye(4), np.ones((2, 2))))
    ratio = np.linalg.eigvals(np.linalg.solve(stated, np.cov(found.T))).real  # of variances, in any direction
    assert ratio.min() > 0.95
    assert ratio.max() < 1.2  # points end before corners do, which makes lines turn a little more


def test_small_tags_and_slanted_ones_are_known_less():
    def worst(corners, floor=0.0):
        return np.sqrt(np.diagonal(corner_covariances(corners, floor, 0.5), axis1=1, axis2=2)).max()

    square = np.array([[[0, 0], [1, 0], [1, 1], [0, 1.0]]])
    assert worst(100 * square) == pytest.approx(worst(40 * square), rel=1e-3)  # sixteen points an edge, all the same
    across = square @ np.array([[0.8, 0.6], [-0.6, 0.8]])  # of pixels, so that no edge runs along them
    assert worst(1e4 * across) == pytest.approx(worst(100 * across) * np.sqrt(16 / 1250), rel=1e-2)
    assert worst(20 * square) > worst(40 * square) and worst(8 * square) > worst(20 * square)
    slanted = square @ np.array([[1.0, 0.0], [0.8, 0.6]])
    assert worst(100 * slanted) > 1.2 * worst(100 * square)
    assert worst(100 * square * [1.0, 0.15]) > 1.2 * worst(100 * square)  # seen nearly from its side
    assert worst(1e4 * square, 0.3) < 0.31


def test_a_tag_on_a_body_has_its_corners_there():
    face = Pose.from_tangent(np.array([0.0, 0.07, 0.3, 0.0, 0.0, 1.0]), 3)
    tag = Tag(3, 0.12, "cube", True, face)
    np.testing.assert_allclose(tag.corners, face.act(0.12 * SQUARE))
    assert np.allclose(s2.of(tag.corners[1] - tag.corners[0]), face.rotation[:, 0])  # x of the tag runs to its right
