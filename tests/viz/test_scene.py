"""Regions hold what they claim; sizes follow from the map."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.model import pose_key
from teamslam.viz import Scene, shape_of


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), dim=st.sampled_from([2, 3]))
def test_region_holds_its_share_of_a_gaussian(seed: int, dim: int) -> None:
    """95 of 100 samples of N(0, C) lie inside the region of C: seven sigmas of a binomial are allowed."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.uniform(-1.0, 1.0, (dim, dim)), -1) + np.diag(rng.uniform(0.1, 2.0, dim))
    radii, axes = shape_of(root @ root.T, 0.95)
    samples = rng.standard_normal((4000, dim)) @ root.T
    inside = np.mean(np.sum((samples @ axes / radii) ** 2, -1) <= 1.0)
    assert abs(inside - 0.95) < 7.0 * np.sqrt(0.95 * 0.05 / 4000)


def test_region_of_a_round_gaussian_has_the_textbook_radius() -> None:
    """In the plane, 95 % lie within sqrt(-2 ln 0.05) = 2.4477 sigmas."""
    radii, _ = shape_of(0.09 * np.eye(2), 0.95)
    assert radii == pytest.approx([0.3 * np.sqrt(-2.0 * np.log(0.05))] * 2)


def test_small_regions_are_enlarged_and_large_ones_are_not(scene_of) -> None:
    """Regions a thousandth of the map get larger, those that anyone can see stay as they are."""
    assert scene_of(2, sd=0.003).magnification(2) > 1
    assert scene_of(2, sd=0.3).magnification(2) == 1


def test_sightings_are_thinned_evenly_and_those_outside_the_map_left_out(scene_of) -> None:
    """Every n-th of the pairs in the map, at most as many as asked for."""
    scene = scene_of(2, 300)
    stranger = np.array([[int(pose_key(1, 0)), int(pose_key(9, 0))]])
    wider = Scene(scene.map, sightings=np.concatenate([scene.sightings, stranger]))
    pairs, step = wider.visible_sightings(40)
    assert step == 3 and len(pairs) == 34
    np.testing.assert_array_equal(pairs, scene.sightings[::3])


def test_a_team_on_the_ground_is_seen_from_above_and_a_flying_one_in_space(scene_of) -> None:
    """Landmarks at a height do not make planar robots fly."""
    assert not scene_of(2).is_spatial
    assert scene_of(3).is_spatial
