"""A robot maps while its camera films; a film plays the camera."""

from pathlib import Path

import numpy as np
import pytest

from live_film import FRAMES, shot, team
from teamslam.io.submaps.arrays import read_submap

pytest.importorskip("cv2")


def test_a_robot_maps_while_a_camera_films(teamslam, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through the command: a pose for each image that is used, and the submaps of the recording."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = team(shot(tmp_path), 0.25)
    out = tmp_path / "live"
    called = teamslam("robot", path, "--camera", tmp_path / "film.avi", "--out", out)
    assert called.code == 0, called.err
    assert len((out / "poses.csv").read_text().splitlines()) == 1 + FRAMES // 2
    played = teamslam("robot", path, "--out", tmp_path / "played")
    assert played.code == 0
    names = sorted(file.name for file in (out / "submaps").iterdir())
    assert names and names == sorted(file.name for file in (tmp_path / "played" / "submaps").iterdir())
    for name in names:
        one, other = (read_submap(of / "submaps" / name) for of in (out, tmp_path / "played"))
        np.testing.assert_allclose(one.values.state, other.values.state, atol=1e-9)
