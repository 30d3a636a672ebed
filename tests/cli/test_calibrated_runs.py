"""What is put right is told, stays in the files, and travels with the map."""

import json
from pathlib import Path

import pytest

from teamslam.io import write
from trust.calibration.faulty import long_steps, team


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("long_steps") / "log"
    write(long_steps(team(3, poses=80)), folder)
    return folder


def test_what_was_put_right_is_said_and_travels_with_the_map(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("run", log, "--out", tmp_path / "map", "--no-figures")
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    told = report["calibration"]
    assert called.code == 0 and told["systematic"]
    assert all(sentence.split(" (")[0] in called.out for sentence in told["sentences"])
    assert {(e["robot"], e["source"], e["term"]) for e in told["systematic"]} == {
        (robot, "odometry", "scale") for robot in "123"
    }
    assert [sigmas["what"] for sigmas in told["sigmas_m"]] == ["landmarks", "robots"]
    assert all(0.0 < sigmas["noise"] <= sigmas["whole"] for sigmas in told["sigmas_m"])
    again = teamslam("join", tmp_path / "map" / "maps", "--out", tmp_path / "again", "--truth", log, "--no-figures")
    assert again.code == 0
    for field in ("nees_per_dof", "landmark_rmse_m", "robot_position_rmse_m"):
        scores = [json.loads((tmp_path / name / "report.json").read_text())[field] for name in ("map", "again")]
        assert scores[0] == pytest.approx(scores[1], rel=1e-9), field
    others = teamslam("convert", tmp_path / "map" / "maps", tmp_path / "map.csv")
    assert others.code == 0 and "systematic" not in (tmp_path / "map.csv").read_text()


def test_where_it_is_not_wanted_the_noise_is_taken_as_stated(teamslam, log: Path, tmp_path: Path) -> None:
    assert teamslam("run", log, "--out", tmp_path / "map", "--no-calibrate", "--no-figures").code == 0
    assert json.loads((tmp_path / "map" / "report.json").read_text())["calibration"] is None


def test_workers_are_refused_in_words(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("run", log, "--out", tmp_path / "map", "--calibrate", "--workers", "2")
    assert called.code == 2 and "--calibrate" in called.err
