"""The virtual lab from the command line: what is written, and that it can be mapped and scored."""

import json

import numpy as np
import pytest

import teamslam as ts
from teamslam.io.bags import opened, read_track
from teamslam.io.bags.calibration import camera_in
from teamslam.io.bags.team_file import read_team_file, write_team_file
from teamslam.sim.film import Options, film


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.parametrize("kind", ["mcap", "bag"])
def test_a_film_is_recorded_as_it_was(kind, teamslam, tmp_path):
    called = teamslam("film", tmp_path / "lab", "--seconds", 1, "--images-hz", 2, "--seed", 5, "--to", kind, "--json")
    assert called.code == 0 and json.loads(called.out)["images"] == 4
    made = film(Options(seconds=1.0, images_hz=2.0), 5)
    for robot in made.robots:
        path = tmp_path / "lab" / f"robot{robot + 1}{'.bag' if kind == 'bag' else ''}"
        assert not [p.name for p in path.parent.rglob(".*")]
        with opened(path) as recording:
            for topic, track in (("/odom", made.odometry(robot)), ("/mocap/pose", made.truth(robot))):
                read = read_track(recording, topic)
                assert np.array_equal(read.ticks, track.ticks) and read.parent == track.parent
                assert np.allclose(read.poses.translation, track.poses.translation)
                assert np.allclose(read.poses.rotation, track.poses.rotation)
            assert camera_in(recording, "/camera/camera_info") == made.options.camera
            (first, *_) = recording.messages(["/camera/image_raw"])
            frame = next(made.frames(robot))
            assert first.tick == frame.tick
            assert np.array_equal(recording.decode(first).data, frame.image.ravel())
            (deep, *_) = recording.messages(["/camera/depth_registered/image_raw"])
            found = recording.decode(deep)
            assert deep.tick == frame.tick and found.encoding == "16UC1"
            assert np.array_equal(found.data.view("<u2"), frame.depth.ravel())
    team = read_team_file(tmp_path / "lab" / "team.toml")
    write_team_file(team, tmp_path / "again.toml")
    assert read_team_file(tmp_path / "again.toml") == team


def test_a_film_is_mapped_and_scored(teamslam, tmp_path):
    assert teamslam("film", tmp_path / "lab", "--seconds", 8, "--images-hz", 1, "--seed", 0).code == 0
    log = ts.read(tmp_path / "lab" / "team.toml")
    assert log.truth is not None and set(log.truth.layout.keys) >= set(log.landmark_keys)
    called = teamslam("run", tmp_path / "lab" / "team.toml", "--out", tmp_path / "map", "--no-figures", "--json")
    found = json.loads(called.out)
    assert called.code in (0, 1, 3)  # few images: a map may come in parts, or doubt itself
    assert found["converged"] and not found["fit"]["gross"]
    names = {path.name for path in (tmp_path / "map" / "frames").iterdir()}
    assert {"worst_1.png", "best_1.png"} <= names and (tmp_path / "map" / "table_3.csv").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--preset", "theatre"), "unknown preset 'theatre'"),
        (("--to", "mp4"), "mcap or bag"),
        (("--seconds", 0), "lasts 1 s to an hour"),
        (("--seed", -1), "a seed is a whole number"),
    ],
)
def test_what_cannot_be_filmed_is_refused(options, words, teamslam, tmp_path):
    called = teamslam("film", tmp_path / "lab", *options)
    assert called.code == 2 and words in called.err and not (tmp_path / "lab").exists()


def test_a_film_does_not_replace_anything(teamslam, tmp_path):
    (tmp_path / "lab").mkdir()
    assert teamslam("film", tmp_path / "lab").code == 2
