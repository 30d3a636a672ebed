"""A camera by views of a board: right where they determine it, and said where they do not."""

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.frontend.boards import AprilGrid, Charuco, Views, calibrate, fit
from teamslam.frontend.boards.bundle import as_read
from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import Pose

BOARD = Charuco(8, 6, 0.04, 0.03)
SIZE = (640, 480)
CAMERAS = {
    "radtan 5": Camera((525.0, 522.0), (318.0, 242.0), "radtan", (0.05, -0.11, 0.0008, -0.0005, 0.02), SIZE),
    "radtan 8": Camera((410.0, 411.0), (322.0, 236.0), "radtan", (0.5, -0.2, 0.001, 0.0, 0.02, 0.8, -0.1, 0.0), SIZE),
    "equidistant": Camera((215.0, 214.0), (317.0, 243.0), "equidistant", (-0.012, -0.01, 0.0075, -0.0025), SIZE),
}
FACING = np.diag([1.0, -1.0, -1.0])  # the board upright before the camera


def views_of(camera, lean, seed, count=16, sigma=0.05, far=0.45, near=0.25, points=None):
    """What a camera sees of the board, leaned by up to `lean` [rad] to all sides (or as `lean(rng)` says)."""
    rng = np.random.default_rng(seed)
    points = BOARD.points if points is None else points
    found = []
    while len(found) < count:
        turn = lean(rng) if callable(lean) else rng.uniform(-lean, lean, 3)
        distance = rng.uniform(near, far)
        place = distance * np.array([*rng.uniform(-0.35, 0.35, 2), 1.0])
        place -= FACING @ points.mean(0)
        pose = Pose(FACING @ Pose.from_tangent(np.array([0, 0, 0, *turn]), 3).rotation, place)
        pixels = camera.project(pose.act(points))
        seen = np.isfinite(pixels).all(-1) & (pixels > 2).all(-1) & (pixels < np.array(SIZE) - 3).all(-1)
        if seen.sum() >= 12:
            ids = np.flatnonzero(seen)
            found.append((ids, pixels[ids] + sigma * rng.normal(size=(len(ids), 2))))
    return Views.of(SIZE, list(range(count)), found)


@pytest.mark.parametrize("name", CAMERAS)
def test_every_lens_is_found_within_its_sigmas(name):
    camera = CAMERAS[name]
    found = fit(views_of(camera, 0.7, 1), BOARD.points, camera.model, len(camera.distortion))
    off = np.array([*found.camera.focal, *found.camera.centre]) - [*camera.focal, *camera.centre]
    assert np.abs(off / found.sigmas[:4]).max() < 4.0 and np.abs(off).max() < 2.0
    # 2 numbers of noise a corner, less what is fitted
    free = 1.0 - (len(found.covariance) + 6 * len(found.views)) / found.residuals.size
    assert found.rms == pytest.approx(0.05 * np.sqrt(2.0 * free), rel=0.06)
    seen, true = (one.rays(found.views.pixels)[0] for one in (found.camera, camera))
    assert np.degrees(np.arccos(np.clip(np.sum(seen * true, -1), -1, 1))).max() < 0.25


def test_the_formal_sigma_holds_where_only_corners_err():
    camera = CAMERAS["radtan 5"]
    z = []
    for seed in range(4):
        found = fit(views_of(camera, 0.7, 10 + seed, count=10), BOARD.points, "radtan", 5)
        z.append((found.focal - np.sqrt(np.prod(camera.focal))) / found.formal_sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(z))) < 2.0


def test_views_from_many_angles_determine_the_focal_length():
    found = calibrate(views_of(CAMERAS["radtan 5"], 0.7, 2), BOARD)
    assert found.is_determined and found.chosen.name == "radtan 5"
    assert abs(found.chosen.fit.focal - np.sqrt(525.0 * 522.0)) < 3.0 * found.sigma < 6.0
    assert {c.name for c in found.alike} >= {"radtan 5", "radtan 8"}


def test_views_from_one_angle_do_not():
    def leaned(rng):
        return np.array([np.radians(rng.uniform(7.0, 9.0)), 0.0, 0.0])

    found = calibrate(views_of(CAMERAS["radtan 5"], leaned, 3, near=0.5, far=0.51), BOARD)
    low, high = found.between_models
    assert not found.is_determined
    assert max(high - low, found.chosen.between_halves) > 0.01 * found.chosen.fit.focal
    assert found.sigma > abs(found.chosen.fit.focal - np.sqrt(525.0 * 522.0)) / 3.0
    assert np.degrees(found.tilts).max() < 15.0


def test_a_board_that_is_stretched_is_found_out():
    stretched = BOARD.points * [1.0, 1.01, 1.0]
    found = calibrate(views_of(CAMERAS["radtan 5"], 0.7, 4, points=stretched), BOARD)
    assert found.chosen.loose and found.chosen.fit.stretch == pytest.approx(0.01, abs=5e-4)
    assert found.is_determined and abs(found.chosen.fit.focal - np.sqrt(525.0 * 522.0)) < 4.0 * found.sigma


def test_corners_that_are_none_are_left_out():
    views = views_of(CAMERAS["radtan 5"], 0.7, 5)
    pixels = views.pixels.copy()
    wrong = np.random.default_rng(0).choice(len(pixels), 15, replace=False)
    pixels[wrong] += 30.0
    planted = Views(views.size, views.frames, views.view, views.corner, pixels)
    kept = as_read(fit(planted, BOARD.points, "radtan", 5))
    lost = set(zip(planted.view.tolist(), planted.corner.tolist(), strict=True)) - set(
        zip(kept.view.tolist(), kept.corner.tolist(), strict=True)
    )
    truly = {(int(planted.view[k]), int(planted.corner[k])) for k in wrong}
    assert truly <= lost and len(lost) < 2 * len(truly)  # a few neighbours go with them


def test_too_few_views_are_refused():
    with pytest.raises(InputError, match="seen in 5 images; a calibration needs 8"):
        calibrate(views_of(CAMERAS["radtan 5"], 0.7, 6, count=5), BOARD)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Charuco(2, 6, 0.04, 0.03), "at least 3 columns and rows, found 2 x 6"),
        (lambda: Charuco(8, 6, 0.04, 0.05), "a marker is smaller than its square"),
        (lambda: AprilGrid(6, 6, 0.0), "above 0"),
        (lambda: AprilGrid(6, 6, 0.1, family="tag49"), "unknown family 'tag49'"),
    ],
)
def test_what_is_no_board_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
