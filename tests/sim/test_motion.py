"""How robots move: eq. (15) without its singularity, and paths that stay where they should."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.geometry import Pose
from teamslam.sim import PATHS, Arena, drive
from teamslam.sim.motion import fly

angles = st.floats(-3.0, 3.0)


@given(theta=angles, v=st.floats(0.1, 2.0), w=st.floats(0.05, 2.0), dt=st.floats(0.1, 1.0))
def test_an_arc_is_the_corrected_equation_15(theta: float, v: float, w: float, dt: float) -> None:
    """The textbook form with v / w, away from its singularity."""
    track = drive(np.array([1.0, 2.0, theta]), np.array([v * dt]), np.array([w * dt]))
    expected = [
        1.0 + v / w * (-np.sin(theta) + np.sin(theta + w * dt)),
        2.0 + v / w * (np.cos(theta) - np.cos(theta + w * dt)),
        theta + w * dt,
    ]
    assert np.allclose(track[1], expected, atol=1e-12)


@given(theta=angles, turn=st.floats(-1e-9, 1e-9))
def test_straight_on_is_no_singularity(theta: float, turn: float) -> None:
    """An arc that does not turn is a straight line."""
    track = drive(np.array([0.0, 0.0, theta]), np.array([2.0]), np.array([turn]))
    assert np.allclose(track[1, :2], [2.0 * np.cos(theta), 2.0 * np.sin(theta)], atol=1e-8)


@given(theta=angles, turn=st.floats(-2.0, 2.0), parts=st.integers(2, 7))
def test_an_arc_in_parts_ends_where_the_whole_ends(theta: float, turn: float, parts: int) -> None:
    """A robot that keeps its controls does not care how often it is looked at."""
    start = np.array([0.3, -0.2, theta])
    whole = drive(start, np.array([1.0]), np.array([turn]))
    split = drive(start, np.full(parts, 1.0 / parts), np.full(parts, turn / parts))
    assert np.allclose(whole[-1], split[-1], atol=1e-12)


def test_tracks_of_a_batch_are_those_of_each_robot() -> None:
    """Any leading axes."""
    rng = np.random.default_rng(0)
    start, length, turn = rng.normal(size=(4, 3)), rng.random((4, 6)), rng.normal(size=(4, 6))
    together = drive(start, length, turn)
    assert np.allclose(together, np.stack([drive(s, n, t) for s, n, t in zip(start, length, turn, strict=True)]))


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("robots", [1, 5])
def test_paths_stay_near_the_arena_at_an_even_pace(path: str, robots: int) -> None:
    """Every path keeps robots together, so that they can meet, and none jumps."""
    arena = Arena(side_m=20.0, height_m=3.0)
    tracks = PATHS[path](robots, 400, 0.4, arena, np.random.default_rng(1))
    assert tracks.shape == (robots, 400, 3)
    steps = np.linalg.norm(np.diff(tracks[..., :2], axis=1), axis=-1)
    assert (steps <= 0.4 + 1e-12).all() and (steps > 0.3).all()
    assert np.abs(tracks[..., :2]).max() < 0.7 * arena.side_m


def test_the_lawn_mower_covers_its_strip_and_comes_back() -> None:
    """Lanes side by side, and then the same lanes again."""
    tracks = PATHS["lawn_mower"](1, 2000, 0.4, Arena(20.0, 3.0), np.random.default_rng(0))
    xy = tracks[0, :, :2]
    assert np.ptp(xy[:, 0]) > 15.0 and np.ptp(xy[:, 1]) > 15.0
    first_again = np.flatnonzero(np.linalg.norm(xy[500:] - xy[0], axis=-1) < 0.5)
    assert len(first_again)


def test_a_flying_robot_follows_its_track_and_looks_where_it_goes() -> None:
    """The shadow of the flight is the track; the nose points along the way."""
    track = drive(np.zeros(3), np.full(200, 0.4), np.full(200, 0.05))
    way = fly(track, 4.0, np.random.default_rng(0))
    assert np.allclose(way.translation[:, :2], track[:, :2])
    assert way.translation[:, 2].min() >= 1.0 and way.translation[:, 2].max() <= 3.0
    assert np.allclose(way.rotation @ np.swapaxes(way.rotation, -1, -2), np.eye(3), atol=1e-12)
    ahead = way.translation[2:] - way.translation[:-2]
    along = np.sum(way.rotation[1:-1, :, 0] * ahead, -1) / np.linalg.norm(ahead, axis=-1)
    assert along.min() > 0.99
    assert isinstance(way, Pose)
