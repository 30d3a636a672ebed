"""Radio anchors of which one is farther away for all who range it, as where its signal comes by way of a wall."""

from pathlib import Path

import numpy as np
import pytest

from teamslam.pipeline import Result, run
from teamslam.trust.calibration.words import sentences

TEAM = """
[[robot]]
name = "one"
[[robot]]
name = "two"
[[log]]
file = "odometry.csv"
model = "relative_pose"
sigma = [0.02, 0.01, 0.005]
[[log]]
file = "ranges.csv"
model = "range"
sigma = [0.1]
[[log]]
file = "survey.csv"
model = "position"
sigma = [0.02, 0.02]
[truth]
robots = "robots.csv"
landmarks = "anchors.csv"
"""
ANCHORS = {"a": (0.0, 0.0), "b": (12.0, 0.0), "c": (12.0, 10.0), "d": (0.0, 10.0), "e": (6.0, -1.0)}
STEPS, LONGER = 60, 0.6


def mapped(folder: Path, seed: int, longer: float) -> Result:
    """Two robots that drive in circles within range of surveyed anchors, of which c is `longer` away than it is."""
    rng = np.random.default_rng(seed)
    odometry, ranges = ["robot,from_stamp,to_stamp,x,y,theta"], ["robot,stamp,landmark,range"]
    way = ["robot,stamp,x,y,theta"]
    for robot, (x, y, heading) in {"one": (6.0, 2.0, 0.0), "two": (8.0, 8.0, 3.0)}.items():
        for k in range(STEPS):
            way.append(f"{robot},{k},{x},{y},{heading}")
            for name, at in ANCHORS.items():
                far = np.hypot(at[0] - x, at[1] - y) + longer * (name == "c") + 0.1 * rng.normal()
                ranges.append(f"{robot},{k},{name},{far}")
            if k + 1 < STEPS:
                dx, dy, turn = (0.5, 0.0, 0.17) + rng.normal(size=3) * (0.02, 0.01, 0.005)
                odometry.append(f"{robot},{k},{k + 1},{dx},{dy},{turn}")
                x, y, heading = x + 0.5 * np.cos(heading), y + 0.5 * np.sin(heading), heading + 0.17
    survey = [
        "landmark,x,y",
        *(f"{n},{x + 0.02 * rng.normal()},{y + 0.02 * rng.normal()}" for n, (x, y) in ANCHORS.items()),
    ]
    known = ["landmark,x,y", *(f"{name},{x},{y}" for name, (x, y) in ANCHORS.items())]
    files = {"odometry": odometry, "ranges": ranges, "survey": survey, "robots": way, "anchors": known}
    for file, rows in files.items():
        (folder / f"{file}.csv").write_text("\n".join(rows) + "\n")
    (folder / "team.toml").write_text(TEAM)
    return run(folder)


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
