"""`info` says what a log holds, and its exit code whether the robots look joinable."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import recordings
from teamslam.io import write
from worlds import team


def test_a_team_that_can_be_joined(teamslam, tmp_path: Path) -> None:
    """Counts for each robot and sensor, links, truth."""
    write(team("2d", poses=6), tmp_path / "log", "plain")
    called = teamslam("info", tmp_path / "log")
    assert called.code == 0
    for word in ("odometry", "relative_pose", "common landmarks", "1 - 2", "truth"):
        assert word in called.out


def test_a_sensor_that_measured_nothing_has_no_times_and_takes_nobody_elses(teamslam, tmp_path: Path) -> None:
    """Its file has its header alone, and comes first."""
    write(team("2d", poses=6), tmp_path / "log", "plain")
    odometry = tmp_path / "log" / "odometry_1.csv"
    odometry.write_text(odometry.read_text().splitlines()[0] + "\n")
    called = teamslam("info", tmp_path / "log")
    assert "nan" not in called.out.replace(str(tmp_path), "") and "counted from pose 0" in called.out


def test_a_team_that_cannot_be_joined_ends_with_code_1_and_the_cure(teamslam, tmp_path: Path) -> None:
    """Robot 3 sees nobody and nothing that others see."""
    whole = team("2d", poses=6)
    log = whole.with_tables(
        table.select(np.full(len(table), table.source == "odometry" or (table.robot == 1 and table.source == "robots")))
        for table in whole.tables
    )
    write(log, tmp_path / "log", "plain")
    called = teamslam("info", tmp_path / "log")
    assert called.code == 1
    assert "robot 3 cannot be joined to robots 1 and 2: nothing in common" in called.out
    assert "2 groups of robots" in called.out


def test_a_recording_is_listed_and_gets_a_team_file(teamslam, data) -> None:
    """A stereo pair with odometry: three topics of 4,500 messages at 20 Hz, and a team file that TOML can read."""
    called = teamslam("info", data("tagslam_dupont") / "test_11" / "tag_detections.bag")
    assert called.code == 0
    for words in ("13,500", "224.9 s", "/fla/vio/odom", "odometry", "20.0"):
        assert words in called.out
    team = tomllib.loads(called.out.partition("\n\n")[2].partition("A first team file")[2].partition("\n\n")[2])
    (robot,) = team["robot"]
    assert robot["odometry"] == "/fla/vio/odom"
    assert [camera["tags"] for camera in robot["camera"]] == ["/fla/ovc_node/left/tags", "/fla/ovc_node/right/tags"]
    assert [camera["name"] for camera in robot["camera"]] == ["left", "right"]


def test_cameras_are_told_by_their_names(teamslam, tmp_path: Path) -> None:
    """Of a team file with two cameras each has a row of its own."""
    pytest.importorskip("rosbags")
    square = np.array([[60.0, 60.0], [60.0, 40.0], [80.0, 40.0], [80.0, 60.0]])
    seen = [
        recordings.detections(f"/{name}/tags", stamp, [(3, square + 0.1 * stamp * 1e-9)])
        for stamp in range(10**9, 5 * 10**9, 10**9)
        for name in ("left", "right")
    ]
    recordings.write(tmp_path, "mcap", seen)
    (tmp_path / "camera.json").write_text(
        '{"camera_matrix": [200, 0, 85, 0, 200, 55, 0, 0, 1], "distortion_coefficients": [], '
        '"image_width": 170, "image_height": 110}'
    )
    cameras = "".join(
        f'[[robot.camera]]\nname = "{name}"\ntags = "/{name}/tags"\ncalibration = "camera.json"\n'
        for name in ("left", "right")
    )
    (tmp_path / "team.toml").write_text(
        f'[tags]\nsize_m = 0.2\n[[robot]]\nname = "one"\nrecording = "recording"\n{cameras}'
    )
    called = teamslam("info", tmp_path / "team.toml")
    assert "landmarks, left" in called.out and "landmarks, right" in called.out


def test_what_was_surveyed_has_no_time_and_takes_nobody_elses(teamslam, tmp_path: Path) -> None:
    """Landmarks at known places, by nobody: no row of the table holds a number that is none."""
    write(team("2d", poses=6), tmp_path / "log", "plain")
    (tmp_path / "log" / "survey.csv").write_text("landmark,x,y\n0,1.0,2.0\n1,3.0,4.0\n")
    with (tmp_path / "log" / "team.toml").open("a") as file:
        file.write('\n[[log]]\nfile = "survey.csv"\nmodel = "position"\nsigma = [0.1, 0.1]\n')
    called = teamslam("info", tmp_path / "log")
    assert "position" in called.out and "nan" not in called.out.replace(str(tmp_path), "")


def test_one_of_several_inputs_that_is_not_there_is_named(teamslam, tmp_path: Path) -> None:
    """Not that there are several."""
    write(team("2d", poses=6), tmp_path / "log", "plain")
    called = teamslam("info", tmp_path / "log", tmp_path / "typo.bag")
    assert called.code == 2 and "typo.bag: there is no such file or folder" in called.err
