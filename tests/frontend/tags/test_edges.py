"""Edges that another thing covers in part: they are known as such, and no edge that nothing covers is taken for one."""

import numpy as np
import pytest

from tag_pictures import picture, square
from teamslam.frontend.tags.detect import Detector, Looking
from teamslam.frontend.tags.edges import CUT, cell_widths, edge_widths
from teamslam.frontend.tags.noise import corner_covariances

TRUE = square((90.3, 90.7), 96, 0.02)  # its cells are 12 pixels wide
SIDES = {"bottom": 0, "right": 1, "top": 2, "left": 3}  # edge k goes from corner k to the next
WHITE = 230.0  # of the margin, as tag_pictures have it


def covered(image, side, along, deep, grey):
    """The image with a rectangle before one side of TRUE, from `along[0]` to `along[1]` of it and `deep` pixels into
    the frame; it begins beyond the margin."""
    image, (low, high) = image.copy(), (90.5 - 48, 90.5 + 48)
    a, b = (round(low + 96 * share) for share in along)
    near, far = round(low + deep), round(high - deep)
    where = {"left": (slice(a, b), slice(0, near)), "right": (slice(a, b), slice(far, None)),
             "top": (slice(0, near), slice(a, b)), "bottom": (slice(far, None), slice(a, b))}  # fmt: skip
    image[where[side]] = grey
    return image


PLACES = [((0.4, 0.6), 8), ((0.65, 1.2), 8), ((-0.2, 0.45), 8), ((0.3, 0.4), 10)]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("grey", [20.0, 120.0, 190.0, WHITE])
@pytest.mark.parametrize(("along", "deep"), PLACES)
def test_an_edge_that_is_covered_in_part_is_not_known_and_the_others_are(side, grey, along, deep):
    image = covered(picture({3: TRUE}, (180, 180), blur=0.6, noise=2.0), side, along, deep, grey)
    known = edge_widths(image, TRUE[None])[0] < CUT
    assert not known[SIDES[side]]
    if 0.0 < along[0] < along[1] < 1.0:
        assert np.count_nonzero(known) == 3


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("grey", [120.0, 190.0, WHITE])
@pytest.mark.parametrize(("along", "deep"), PLACES)
def test_a_tag_that_is_found_though_covered_is_where_it_is_said_to_be(side, grey, along, deep):
    """Most are not found: its frame goes on into what is dark, or is open towards the margin."""
    seen = Detector(Looking())(covered(picture({3: TRUE}, (180, 180), blur=0.6, noise=2.0), side, along, deep, grey))
    assert seen.ids.tolist() in ([], [3])
    for corners, widths in zip(seen.corners, seen.widths, strict=True):
        assert widths[SIDES[side]] == CUT
        error, stated = (corners - TRUE).ravel(), corner_covariances(corners[None], 0.02, 0.08, widths[None])[0]
        assert error @ np.linalg.solve(stated, error) < 3.0 * 8


def test_what_is_not_known_was_wrong_by_pixels():
    image = covered(picture({3: TRUE}, (180, 180), blur=0.6, noise=2.0), "right", (0.65, 1.2), 8, WHITE)
    seen = Detector(Looking())(image)
    claimed = corner_covariances(seen.corners, 0.02, 0.08, np.where(seen.widths == CUT, 0.8, seen.widths))[0]
    error = (seen.corners[0] - TRUE).ravel()
    assert np.abs(error).max() > 1.0 and error @ np.linalg.solve(claimed, error) > 100.0


@pytest.mark.parametrize("family", ["tag36h11", "tag25h9", "tag16h5"])
@pytest.mark.parametrize("side_px", [20, 40, 70, 150])
@pytest.mark.parametrize("lean", [0.0, 0.35])
def test_edges_that_nothing_covers_are_known(family, side_px, lean):
    """However large, blurred, noisy, dark, and whichever way it leans and is turned: 48 edges for each case."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        size = (2 * side_px + 40,) * 2
        true = square(np.array(size) / 2.0 + rng.uniform(0, 1, 2), side_px, rng.uniform(0, 2 * np.pi), lean)
        blur, noise, bright = rng.uniform(0.3, 2.5), rng.uniform(0.5, 5.0), rng.uniform(90.0, 240.0)
        image = picture({int(rng.integers(30)): true}, size, family, blur, noise, seed, dark=15.0, bright=bright)
        assert not (edge_widths(image, true[None]) == CUT).any(), (seed, blur, noise, bright)


@pytest.mark.parametrize("shadow", [0.2, 0.5, 0.8])
def test_a_shadow_covers_nothing(shadow):
    """It takes from both sides of an edge alike, as gradients do."""
    image = picture({3: TRUE}, (180, 180), blur=0.6).astype(float)
    y, x = np.mgrid[0:180, 0:180]
    for turn in np.linspace(0.0, np.pi, 5):
        far = (x - 95.0) * np.cos(turn) + (y - 85.0) * np.sin(turn)
        lit = image * (shadow + (1.0 - shadow) / (1.0 + np.exp(-far / 1.5))) * (1.0 - 0.3 * x / 180.0)
        lit += 2.0 * np.random.default_rng(0).normal(size=lit.shape)
        assert not (edge_widths(np.round(np.clip(lit, 0, 255)).astype(np.uint8), TRUE[None]) == CUT).any()


@pytest.mark.parametrize("margin_px", [3, 5, 8])
def test_a_margin_that_is_narrower_than_it_should_be_covers_nothing(margin_px):
    image = picture({3: TRUE}, (180, 180), blur=0.0).astype(float)
    inside = np.zeros(image.shape, bool)
    m = margin_px + 48
    inside[90 - m : 92 + m, 90 - m : 92 + m] = True
    y, x = np.mgrid[0:180, 0:180]
    for beyond in (np.full(image.shape, 15.0), 100.0 + 80.0 * np.sign(np.sin(x / 9.0) * np.sin(y / 7.0))):
        assert not (edge_widths(np.where(inside, image, beyond).astype(np.uint8), TRUE[None]) == CUT).any()


def test_families_with_a_white_frame_in_a_black_one_are_alike():
    whole = picture({3: TRUE}, (180, 180), blur=0.6, noise=2.0)
    for image, count in ((whole, 0), (covered(whole, "top", (0.4, 0.6), 8, 190.0), 1)):
        one, exchanged = (edge_widths(x, TRUE[None]) == CUT for x in (image, 255 - image))
        assert np.count_nonzero(one) == count and np.array_equal(one, exchanged)


def test_where_cells_are_too_small_nothing_is_told():
    """Three widths of an edge: with less, what is beyond the margin is seen through it."""
    small = square((30.2, 30.4), 22, 0.1)
    image = picture({3: small}, (60, 60), blur=1.3)
    image[36:46, 26:32] = 120
    assert not (edge_widths(image, small[None]) == CUT).any()


def test_a_cell_is_as_wide_as_it_is_drawn():
    leaned = np.array([[0.0, 40.0], [80.0, 40.0], [80.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(cell_widths(leaned[None])[0], [5.0, 10.0, 5.0, 10.0])
