"""A live map shows what is known, and where the robot is, and takes away what is not there any more."""

import urllib.request
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from teamslam.io import write
from teamslam.live import drive, replayed
from teamslam.robot import Options, Robot
from worlds import team

pytest.importorskip("viser")
from teamslam.viewer.live import LiveMap, marks, ways
from teamslam.viewer.server import FIELD_RAD, follow, framed

LOG = team("2d", robots=1, poses=24, landmarks=6, sees=0.8)


def test_what_is_drawn_is_the_map() -> None:
    *_, end = drive(Robot.of(LOG, 1, Options(poses_per_piece=9)), (tables for _, tables in replayed(LOG, 1)))
    made = end.atlas.joined
    assert made is not None
    drawn, places = ways(made.map), marks(made.map)
    assert set(drawn) == {1} and np.isfinite(drawn[1]).all() and np.array_equal(drawn[1][1:, 0], drawn[1][:-1, 1])
    assert len(places) == len(made.map.landmark_keys)
    for name, place in places.items():
        key = next(k for k in made.map.landmark_keys if made.map.names.landmark(int(k)) == name)
        assert np.allclose(place[:2], made.map.values.positions(np.array([key]), 2)[0])


def test_it_is_served_and_changes() -> None:
    live = LiveMap(0)
    try:
        moments = list(drive(Robot.of(LOG, 1, Options(poses_per_piece=9)), (t for _, t in replayed(LOG, 1))))
        for moment in moments:
            if moment.atlas.joined is not None:
                live.show(moment.atlas.joined.map)
            if moment.now is not None:
                live.at(moment.now)
        assert "/marks" in live._drawn and "/ways/1" in live._drawn
        with urllib.request.urlopen(live.address, timeout=30) as page:
            assert page.status == 200
    finally:
        live.close()


def test_the_command_says_where_it_is(teamslam, tmp_path: Path) -> None:
    write(LOG, tmp_path / "log", "plain")
    called = teamslam("robot", tmp_path / "log", "--out", tmp_path / "one", "--poses-per-piece", 9, "--view", 0)
    assert called.code == 0 and "live map: http://127.0.0.1:" in called.out and "viser" not in called.out


def test_all_of_a_map_is_in_view() -> None:
    """Wherever it lies and however flat or long it is: within the cone that has the field of view's angle."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        places = rng.normal(size=(int(rng.integers(1, 30)), 3)) * rng.choice([0.0, 0.1, 1.0, 300.0], 3) + 50.0
        look_at, position = framed(places)
        ahead, there = look_at - position, places - position
        lengths = np.linalg.norm(there, axis=1) * np.linalg.norm(ahead)
        assert (there @ ahead >= lengths * np.cos(0.5 * FIELD_RAD)).all()


def test_who_looks_on_follows_a_map_that_grows_until_they_look_around() -> None:
    live = LiveMap(0)
    try:
        *_, end = drive(Robot.of(LOG, 1, Options(poses_per_piece=9)), (t for _, t in replayed(LOG, 1)))
        assert end.atlas.joined is not None
        live.show(end.atlas.joined.map)
        look_at, position = framed(end.atlas.joined.map.all_values.positions(end.atlas.joined.map.keys, 3))
        assert np.allclose(live.server.initial_camera.position, position)
        there, elsewhere = (SimpleNamespace(camera=SimpleNamespace(position=p)) for p in (position, position + 1.0))
        follow([there, elsewhere], position, look_at + 3.0, position + 3.0)
        assert np.allclose(there.camera.position, position + 3.0) and np.allclose(there.camera.look_at, look_at + 3.0)
        assert np.allclose(elsewhere.camera.position, position + 1.0)
    finally:
        live.close()
