"""A live map shows what is known, and where the robot is, and takes away what is not there any more."""

import urllib.request
from pathlib import Path

import numpy as np
import pytest

from teamslam.io import write
from teamslam.live import drive, replayed
from teamslam.robot import Options, Robot
from worlds import team

pytest.importorskip("viser")
from teamslam.viewer.live import LiveMap, marks, ways

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
    assert called.code == 0 and "live map: http://127.0.0.1:" in called.out
