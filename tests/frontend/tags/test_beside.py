"""What is beside the edges of small tags is taken out of their corners."""

import numpy as np
import pytest

from tag_pictures import picture, square
from teamslam.frontend.tags import detect
from teamslam.frontend.tags.beside import undrawn
from teamslam.frontend.tags.detect import SIDES, Detector, Looking
from teamslam.frontend.tags.edges import CELLS, cell_widths

FAMILIES = ("tag36h11", "tag25h9", "tag16h5")
CELL = 2.9  # pixels


def looked(side, family, seed, monkeypatch):
    """The error of the corners of a tag in sharp focus (4, 2), as they are given and as the library has them."""
    rng = np.random.default_rng(seed)
    true = square(60.0 + rng.uniform(-0.5, 0.5, 2), side, rng.uniform(0.1, 0.6))
    image = picture({int(rng.integers(20)): true}, (120, 120), family, blur=0.5, bright=200.0)
    given = Detector(Looking((family,)))(image)
    with monkeypatch.context() as m:
        m.setattr(detect, "undrawn", lambda image, corners, *_: corners)
        plain = Detector(Looking((family,)))(image)
    return None if len(given.ids) != 1 else (given.corners[0] - true, plain.corners[0] - true)


@pytest.mark.parametrize("family", FAMILIES)
def test_small_tags_err_by_less(family, monkeypatch):
    found = [looked(CELL * SIDES[family], family, seed, monkeypatch) for seed in range(40)]
    given, plain = np.array([pair for pair in found if pair is not None]).swapaxes(0, 1)
    assert len(given) > 30
    assert np.sqrt((given**2).mean()) < 0.75 * np.sqrt((plain**2).mean())


@pytest.mark.parametrize("family", FAMILIES)
def test_large_tags_stay(family, monkeypatch):
    given, plain = looked(9.0 * SIDES[family], family, 1, monkeypatch)
    np.testing.assert_allclose(given, plain, atol=2e-3)


def test_what_cannot_be_told_stays():
    corners = square((60.0, 60.0), 30.0)[None]
    flat, sides = np.full((120, 120), 90, np.uint8), np.array([SIDES["tag36h11"]])
    np.testing.assert_array_equal(undrawn(flat, corners, np.full((1, 4), 0.8), sides, 2.0), corners)
    image = picture({3: corners[0]}, (120, 120), blur=0.5)
    np.testing.assert_array_equal(undrawn(image, corners, np.full((1, 4), 1000.0), sides, 2.0), corners)
    assert undrawn(image, corners[:0], np.zeros((0, 4)), sides[:0], 2.0).shape == (0, 4, 2)


def test_cells_are_narrower_at_the_far_edge_of_a_tag():
    """Against the homography of a tag that leans away by 60 degrees, half a side before the camera's axis."""
    half, lean, away, focal = 0.5, np.radians(60.0), 4.0, 300.0

    def seen(points):
        x, y, z = points[:, 0], points[:, 1] * np.cos(lean), away + points[:, 1] * np.sin(lean)
        return focal * np.stack([x, -y], -1) / z[:, None]

    corners = seen(half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))
    step = 1e-4
    for edge, y in ((0, -half), (2, half)):
        here, beside = seen(np.array([[0.0, y], [0.0, y * (1.0 - step)]]))
        there = np.linalg.norm(beside - here) / (step * half) / CELLS
        assert cell_widths(corners[None])[0, edge] == pytest.approx(there, rel=1e-2)
