"""Headings in degrees are told by where a robot goes, and radians are never taken for them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.io import read

TEAM = """
[[robot]]
name = "a"
[[log]]
file = "odometry.csv"
robot = "a"
model = "odometry_poses"
sigma = [1, 1, 1]
"""
SAID = "the robot goes where this points if it is in degrees"


def notes_of(folder: Path, courses: np.ndarray, headings: np.ndarray) -> tuple[str, ...]:
    """What is said of a robot that goes a metre along each of the courses, and says that it has such headings."""
    places = np.concatenate([[0.0], np.cumsum(np.exp(1j * courses))])
    rows = "".join(
        f"{n},{at.real},{at.imag},{h}\n"
        for n, (at, h) in enumerate(zip(places, [*headings, headings[-1]], strict=True))
    )
    (folder / "odometry.csv").write_text("stamp,x,y,theta\n" + rows)
    (folder / "team.toml").write_text(TEAM)
    return read(folder).notes


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), turn=st.floats(0.05, 0.5), backwards=st.booleans(), wrapped=st.booleans())
def test_a_robot_that_goes_where_it_points(
    tmp_path_factory: pytest.TempPathFactory, seed: int, turn: float, backwards: bool, wrapped: bool
) -> None:
    """On arcs of any kind, forwards and backwards, with headings that count turns or do not."""
    rng = np.random.default_rng(seed)
    turns = np.abs(turn + 0.02 * rng.standard_normal(120))
    headings = np.cumsum(turns)
    courses = headings + turns.mean() / 2 + np.pi * (backwards & (rng.random() < 0.5))
    told = np.angle(np.exp(1j * headings)) if wrapped else headings
    folder = tmp_path_factory.mktemp("log")
    assert not notes_of(folder, courses, told)
    (said,) = notes_of(folder, courses, np.degrees(told))
    assert SAID in said and "multiply with pi / 180" in said


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), spread=st.floats(0.0, 7.0), spin=st.floats(-3.0, 3.0))
def test_who_goes_in_any_direction_or_straight_on_says_nothing(
    tmp_path_factory: pytest.TempPathFactory, seed: int, spread: float, spin: float
) -> None:
    """Robots that slide, that spin while they go straight on, and that stand still."""
    rng = np.random.default_rng(seed)
    courses = spread * rng.random(80)
    headings = 0.3 + spin * np.arange(80)
    folder = tmp_path_factory.mktemp("log")
    assert not notes_of(folder, courses, headings)
    assert not notes_of(folder, np.full(80, 0.4), headings)
