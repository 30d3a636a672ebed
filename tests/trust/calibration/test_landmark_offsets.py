"""Radio anchors of which one is farther away for all who range it, as where its signal comes by way of a wall."""

from pathlib import Path

import numpy as np
import pytest

from ranging import write_ranging
from teamslam.geometry import Array
from teamslam.pipeline import Result, run
from teamslam.trust.calibration.words import sentences

ANCHORS = {"a": (0.0, 0.0), "b": (12.0, 0.0), "c": (12.0, 10.0), "d": (0.0, 10.0), "e": (6.0, -1.0)}
STEPS, STEP, TURN, LONGER = 60, 0.5, 0.17, 0.6


def mapped(folder: Path, seed: int, longer: float) -> Result:
    """Two robots that drive in circles within range of surveyed anchors, of which c is `longer` away than it is."""
    ways = {"one": _circle(6.0, 2.0, 0.0), "two": _circle(8.0, 8.0, 3.0)}
    rng, far = np.random.default_rng(seed), {"c": longer}
    return run(write_ranging(folder, rng, ways, ANCHORS, sigma_m=0.1, longer_m=far, surveyed=True))


def _circle(x: float, y: float, heading: float) -> Array:
    headings = heading + TURN * np.arange(STEPS)
    steps = STEP * np.stack([np.cos(headings), np.sin(headings)], -1)
    places = np.array([x, y]) + np.cumsum(steps, 0) - steps
    return np.concatenate([places, headings[:, None]], -1)


@pytest.mark.parametrize("seed", range(3))
def test_an_anchor_that_is_farther_away_for_all_is_found_and_its_survey_believed(tmp_path: Path, seed: int) -> None:
    """A map without that has all anchors' surveys wrong by 10 times what is stated, and that anchor 0.6 m off."""
    result = mapped(tmp_path, seed, LONGER)
    assert result.calibration
    errors = [e for e in result.calibration.systematic if e.term == "landmark offset"]
    called = {e: result.joined.log.names.landmark(e.landmark) if result.joined.log else "" for e in errors}
    own = [e for e in errors if called[e] == "c"]
    assert len(own) == 2 and all(abs(e.value - LONGER) < 4.0 * e.sigma < 0.2 for e in own)
    assert all(abs(e.value) < 4.0 * e.sigma for e in errors if e not in own)
    (score,) = result.scores
    assert score.accuracy and score.nees_per_dof is not None
    assert (score.accuracy.landmark_rmse_m or 1.0) < 0.05 and score.nees_per_dof < 1.3
    assert "landmark c" in " ".join(sentences(result.calibration))


@pytest.mark.parametrize("seed", range(3))
def test_anchors_that_are_where_they_seem_have_no_length_of_their_own(tmp_path: Path, seed: int) -> None:
    result = mapped(tmp_path, seed, 0.0)
    assert not result.calibration or not result.calibration.systematic
