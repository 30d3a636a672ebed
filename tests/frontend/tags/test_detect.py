"""Corners of tags in pictures where they are known: where pixels count from, which corner is which, how well."""

import cv2
import numpy as np
import pytest

from tag_pictures import picture, square
from teamslam.errors import InputError
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.detect import Detector, Looking, of_one_family
from teamslam.frontend.tags.edges import CUT, NARROWEST, SHARP, edge_widths
from teamslam.frontend.tags.noise import corner_covariances

TAGS = {3: square((70.3, 80.7), 90, 0.3), 17: square((220.6, 80.2), 70, -2.0, 0.2), 42: square((150, 200.4), 50, 1.2)}


@pytest.mark.parametrize("family", ["tag36h11", "tag25h9", "tag16h5"])
def test_corners_are_where_they_were_drawn_and_in_the_order_of_streams(family):
    tags = {number % 20: corners for number, corners in TAGS.items()}
    found = Detector(Looking((family,)))(picture(tags, family=family, blur=0.5))
    assert found.ids.tolist() == sorted(tags) and set(found.families) == {family} and not found.hamming.any()
    for number, corners in zip(found.ids.tolist(), found.corners, strict=True):
        # Half a pixel, the trap between libraries, would be five times this; another first corner, hundreds.
        assert np.abs(corners - tags[number]).max() < 0.1


def test_the_same_tag_by_another_program():
    """OpenCV counts pixels as teamslam does; its corners are those of the tag on its head, from the top left on."""
    image = picture(TAGS, blur=0.5)
    look = cv2.aruco.DetectorParameters()
    look.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(book, look).detectMarkers(image)
    theirs = {int(number): square[0] for number, square in zip(ids.ravel(), corners, strict=True)}
    ours = Detector(Looking())(image)
    assert sorted(theirs) == ours.ids.tolist()
    for number, mine in zip(ours.ids.tolist(), ours.corners, strict=True):
        assert np.abs(np.roll(theirs[number][::-1], 2, 0) - mine).max() < 0.5


def test_an_image_without_tags_has_none():
    found = Detector(Looking())(np.full((48, 64), 128, np.uint8))
    assert found.corners.shape == (0, 4, 2) and found.widths.shape == (0, 4) and found.size == (64, 48)


@pytest.mark.parametrize("blur", [0.8, 1.2, 1.8])
def test_edges_are_as_wide_as_they_were_blurred(blur):
    tags = {3: square((90, 90), 110, 0.3), 5: square((270, 90), 100, 1.0)}
    corners = np.array(list(tags.values()))
    widths = edge_widths(picture(tags, (360, 180), blur=blur, noise=2.0), corners)
    assert np.allclose(widths, np.hypot(blur, NARROWEST), rtol=0.1)  # the law of edge_widths


def test_motion_widens_the_edges_across_it():
    tags = {3: square((90, 90), 110)}
    image = cv2.blur(picture(tags, (180, 180), blur=0.5), (7, 1))
    bottom, right, top, left = edge_widths(image, np.array(list(tags.values())))[0]
    assert max(bottom, top) < 0.95 and min(left, right) > 1.5
    smeared = corner_covariances(np.array([tags[3]]), 0.0, 0.5, np.array([[bottom, right, top, left]]))[0]
    across, along = np.sqrt(np.diag(smeared)[::2]), np.sqrt(np.diag(smeared)[1::2])
    assert (across > 1.5 * along).all()  # the motion was from left to right


def test_one_noise_fits_small_tags_and_large_ones_sharp_and_blurred():
    """Pictures with noise: whatever error of a point is stated, squares of errors in sigmas are alike everywhere."""
    found = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        at, turn = rng.uniform(0, 1, (2, 2)), rng.uniform(0.05, 0.7)
        tags = {3: square((80, 80) + at[0], 110, turn), 5: square((230, 80) + at[1], 50, turn)}
        for blur in (0.6, 1.2):
            seen = Detector(Looking())(picture(tags, (320, 160), blur=blur, noise=6.0, seed=seed))
            error = (seen.corners - [tags[k] for k in seen.ids.tolist()]).reshape(-1, 8)
            stated = corner_covariances(seen.corners, 0.01, 0.05, seen.widths)
            found.append(np.sum(error * np.linalg.solve(stated, error[..., None])[..., 0], -1) / 8)
    kinds = np.array(found).reshape(5, 2, 2).mean(0)  # by blur and by size
    assert kinds.max() < 2.5 * kinds.min()  # the law without blur would be 3.5 times apart


def test_no_contrast_says_nothing_of_the_blur():
    grey = np.full((40, 40), 100, np.uint8)
    assert (edge_widths(grey, np.array([square((20, 20), 10)])) == SHARP).all()


def test_an_edge_at_the_border_of_the_image_is_not_known():
    """A tag that the border cuts is found, with an edge that is not there; the others are where they were drawn."""
    true = square((50.6, 90.3), 100, 0.03)  # its left edge is where the image begins, without the white beside it
    seen = Detector(Looking())(picture({3: true}, (180, 180), blur=0.5))
    assert seen.ids.tolist() == [3] and np.abs(seen.corners[0] - true).max() > 0.5
    assert [bool(w == CUT) for w in seen.widths[0]] == [False, False, False, True]
    error, stated = (seen.corners[0] - true).ravel(), corner_covariances(seen.corners, 0.02, 0.08, seen.widths)[0]
    assert error @ np.linalg.solve(stated, error) < 3.0 * 8
    beyond = edge_widths(np.full((40, 40), 100, np.uint8), np.array([square((400, -300), 50)]))
    assert (beyond == CUT).all()


def test_a_number_that_two_families_have_stays_with_one():
    ids = np.array([1, 1, 1, 2])
    seen = TagCorners(np.arange(4), np.arange(4), ids, np.zeros((4, 4, 2)), np.zeros(4, int), ("a", "b", "a", "b"))
    kept, lost = of_one_family(seen)
    assert kept.families == ("a", "a", "b") and list(lost.values()) == [1] and "number 1" in next(iter(lost))


@pytest.mark.parametrize("wrong", [{"families": ("tag36h12",)}, {"families": ()}, {"decimate": 0.5}])
def test_what_cannot_be_looked_for_is_refused(wrong):
    with pytest.raises(InputError, match=r"famil|decimate"):
        Looking(**wrong)
