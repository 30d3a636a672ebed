"""Corners of tags that are seen aslant: the edge beyond an acute corner turns a line, and that goes out again."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from teamslam.frontend.tags.acute import unturned
from teamslam.frontend.tags.detect import Detector, Looking
from teamslam.frontend.tags.edges import CUT

FINE, SIZE = 8, 160


def aslant(edge_px, angle):
    """Corners (4, 2) in the library's order: two upright edges of 70 pixels, and between them edges of `edge_px` that
    rise such that two corners have that angle."""
    rises = edge_px * np.array([np.sin(np.radians(angle)), -np.cos(np.radians(angle))])
    left = np.array([[60.3, 125.2], [60.3, 55.2]])
    return np.concatenate([left[:1], left + rises, left[1:]])


def shown(corners, number, blur_px):
    """An image of a tag with these corners: a pixel is the mean of FINE x FINE points of what the lens makes of it."""
    cv2 = pytest.importorskip("cv2")
    tags = pytest.importorskip("teamslam.sim.film.boards")
    cells = (255.0 * np.kron(tags.tag_picture(number), np.ones((40, 40)))).astype(np.uint8)
    of_square = np.array([[40, 360], [360, 360], [360, 40], [40, 40]]) - 0.5
    there = FINE * (corners + 0.5) - 0.5
    H = cv2.getPerspectiveTransform(of_square.astype(np.float32), there.astype(np.float32))
    fine = cv2.warpPerspective(cells, H, (FINE * SIZE, FINE * SIZE), flags=cv2.INTER_AREA, borderValue=217)
    light = gaussian_filter(fine.astype(float), FINE * blur_px)
    return np.round(light.reshape(SIZE, FINE, SIZE, FINE).mean((1, 3))).astype(np.uint8)


@pytest.mark.parametrize("edge_px, angle, blur_px", [(16, 40, 0.5), (20, 50, 0.4), (24, 40, 0.5), (30, 35, 0.7)])
def test_the_ends_of_short_edges_are_where_they_are(edge_px, angle, blur_px, monkeypatch):
    pytest.importorskip("apriltag")
    true, off = aslant(edge_px, angle), []
    for number in range(8):
        image = shown(true, number, blur_px)
        for turned in (unturned, lambda corners, *_: corners):
            monkeypatch.setattr("teamslam.frontend.tags.detect.unturned", turned)
            found = Detector(Looking())(image)
            assert found.ids.tolist() == [number]
            off.append(found.corners[0] - true)
    across = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])  # the edges that rise
    ours, library = np.mean(np.array(off).reshape(8, 2, 4, 2) @ across, 0)
    assert np.abs(library).max() > 0.13 and np.abs(ours).max() < 0.35 * np.abs(library).max()


def test_rectangles_and_what_is_cut_stay():
    square = np.array([[[10.0, 50.0], [60.0, 50.0], [60.0, 10.0], [10.0, 10.0]]])
    np.testing.assert_allclose(unturned(square, np.full((1, 4), 0.7)), square, atol=1e-9)
    leaned = square + np.array([0.0, 0.9]) * (square[..., :1] - 10.0)
    assert np.abs(unturned(leaned, np.full((1, 4), 0.7)) - leaned).max() > 0.01
    np.testing.assert_array_equal(unturned(leaned, np.full((1, 4), CUT)), leaned)
    assert unturned(np.zeros((0, 4, 2)), np.zeros((0, 4))).shape == (0, 4, 2)
