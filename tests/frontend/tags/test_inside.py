"""Edges that something as bright as the margin covers from end to end are found by the cells inside."""

import numpy as np
import pytest

from tag_pictures import picture, square
from teamslam.frontend.tags.detect import SIDES, Detector, Looking
from teamslam.frontend.tags.edges import CUT, SHARP
from teamslam.frontend.tags.inside import beside_their_cells

SHARP_ONES = np.full((1, 4), SHARP)
FAMILIES = ("tag36h11", "tag25h9", "tag16h5")


def seen(family, cell_px, turn, seed, covered=0.0):
    """A picture of a tag, its right edge covered by so much of a cell of margin, and its corners (4, 2)."""
    rng = np.random.default_rng(seed)
    side = cell_px * SIDES[family]
    size = round(2.2 * side) + 30
    true = square((size / 2.0 + rng.uniform(0, 1), size / 2.0 + rng.uniform(0, 1)), side, turn)
    image = picture({seed % 25: true}, (size, size), family, blur=rng.uniform(0.3, 0.8), noise=2.0, seed=seed)
    if covered:
        x = np.arange(size)[None] - (true[1, 0] - covered * cell_px)
        cover = np.clip(0.5 + x / 1.6, 0.0, 1.0) * (x < 2.5 * cell_px)
        image = np.round(image * (1.0 - cover) + 230.0 * cover).astype(np.uint8)
    return image, true


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("cell_px", [3.5, 6.0, 14.0])
def test_an_edge_that_is_covered_from_end_to_end_is_known(family, cell_px):
    known, covered = 0, 0
    for seed in range(12):
        image, true = seen(family, cell_px, 0.0, seed, covered=0.4)
        found = Detector(Looking((family,)))(image)
        if len(found.ids) != 1:
            continue  # no longer read
        assert abs(found.corners[0, 1, 0] - true[1, 0]) > 0.25 * cell_px  # its edge seems to be that of the cover
        covered += 1
        known += found.widths[0, 1] == CUT
        assert np.count_nonzero(found.widths == CUT) <= 1 + (found.widths[0, 1] != CUT)
    assert covered > 5 and known >= 0.9 * covered


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("cell_px", [2.5, 3.5, 6.0, 14.0])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_edges_with_their_cells_are_known(family, cell_px, turn):
    for seed in range(15):
        image, true = seen(family, cell_px, turn, seed)
        off = np.random.default_rng(seed).normal(0.0, 0.03, true.shape)
        assert not beside_their_cells(image, (true + off)[None], SHARP_ONES, np.array([SIDES[family]])).any()


def test_what_shows_no_cells_says_nothing():
    corners = square((60.0, 60.0), 60.0)[None]
    flat = np.full((120, 120), 90, np.uint8)
    assert not beside_their_cells(flat, corners, SHARP_ONES, np.array([8])).any()
    assert beside_their_cells(flat, corners[:0], np.zeros((0, 4)), np.zeros(0, np.int64)).shape == (0, 4)
