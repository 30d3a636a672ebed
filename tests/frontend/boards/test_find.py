"""Corners of boards in rendered images are where the camera has them."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.frontend.boards import AprilGrid, Charuco, Finder
from teamslam.sim.film import PRESETS
from teamslam.sim.film.shown import EYE, Shown

BOARDS = {
    "charuco": Charuco(8, 6, 0.04, 0.03, "4X4_50"),
    "odd charuco": Charuco(7, 5, 0.04, 0.03, "DICT_4X4_100"),
    "aprilgrid": AprilGrid(5, 4, 0.06, 0.3),
}


@pytest.mark.parametrize("name", BOARDS)
def test_corners_are_found_where_they_are(name):
    pytest.importorskip("cv2")
    board = BOARDS[name]
    shown = Shown(board, replace(PRESETS["ideal"], seconds=1.0, images_hz=1.0), "one-angle", seed=2)
    (image,) = shown.images()
    ids, found = Finder(board)(image)
    middle = (board.points.max(0) + board.points.min(0)) / 2.0
    pixels = shown.options.camera.project(shown.poses(np.zeros(())).act(board.points - middle))
    assert len(ids) > 0.6 * len(board.points) and EYE.dim == 3
    assert np.linalg.norm(found - pixels[ids], axis=-1).max() < 0.5
    assert np.sqrt(np.mean((found - pixels[ids]) ** 2)) < 0.2


def test_an_image_without_the_board_has_none():
    pytest.importorskip("cv2")
    rng = np.random.default_rng(0)
    assert Finder(BOARDS["charuco"])(rng.integers(0, 255, (480, 640)).astype(np.uint8)) is None


def test_an_unknown_dictionary_is_refused():
    pytest.importorskip("cv2")
    with pytest.raises(InputError, match="unknown dictionary '9X9_50'; OpenCV has 4X4_100"):
        Finder(Charuco(8, 6, 0.04, 0.03, "9X9_50"))
