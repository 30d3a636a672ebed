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


def test_what_a_robot_sends_is_put_right_by_what_it_knows_alone(teamslam, log: Path, tmp_path: Path) -> None:
    told = {}
    for name, option in (("as stated", ("--no-calibrate",)), ("honest", ())):
        called = teamslam("build", log, "--out", tmp_path / name, "--json", *option)
        told[name] = json.loads(called.out)["put_right"]
        joined = teamslam("join", tmp_path / name, "--out", tmp_path / f"{name} map", "--truth", log, "--no-figures")
        assert called.code == joined.code == 0
    assert not told["as stated"]
    assert all(any("odometry err by scale" in s for s in sentences) for sentences in told["honest"].values())
    rmse = [
        json.loads((tmp_path / f"{name} map" / "report.json").read_text())["robot_position_rmse_m"] for name in told
    ]
    assert rmse[1] < rmse[0]


def test_submaps_of_a_right_model_are_the_same_to_the_bit(teamslam, tmp_path: Path) -> None:
    write(team(51, poses=40), tmp_path / "log")
    for name, option in (("as stated", ("--no-calibrate",)), ("asked", ())):
        assert teamslam("build", tmp_path / "log", "--out", tmp_path / name, *option).code == 0
    one, other = ([path.read_bytes() for path in sorted((tmp_path / n).iterdir())] for n in ("as stated", "asked"))
    assert len(one) == 3 and one == other
