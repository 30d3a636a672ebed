"""Scores against truth as others keep it: TUM files, CSV files, of runs and of estimates; evo is the oracle."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import teamslam as ts
from teamslam.io.maps.tum import read_trajectory, write_trajectories, write_trajectory
from teamslam.model import Names

NAMES = Names({1: "red", 2: "blue"}, {}, 1e-6)


@pytest.fixture(scope="module", params=["2d", "planar", "3d"])
def place(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of two robots with truth, and its run; the truth alone as TUM files and as CSV files."""
    from teamslam.cli import main

    folder = tmp_path_factory.mktemp("score")
    log = ts.simulate(request.param, robots=2, poses=30, landmarks=12, seed=5)
    ts.write(replace(log, names=NAMES), folder / "log")
    assert main(["run", str(folder / "log"), "--out", str(folder / "run"), "--no-figures", "-q"]) in (0, 1)
    write_trajectories(ts.read(folder / "log").truth, NAMES, _made(folder / "truth"))
    return folder


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def scored(teamslam, *arguments: object) -> dict:
    called = teamslam("score", *arguments, "--json")
    assert called.code == 0, called.err
    (part,) = json.loads(called.out)["components"]
    return part


def test_tum_files_say_what_the_truth_in_the_log_says(teamslam, place: Path) -> None:
    """Of the ways; the fit of the team rests on poses and landmarks there, on poses here."""
    by_log, by_tum = scored(teamslam, place / "run", place / "log"), scored(teamslam, place / "run", place / "truth")
    for one, other in zip(by_log["robots"], by_tum["robots"], strict=True):
        for name in ("robot", "poses"):
            assert one[name] == other[name]
        for name in ("ate_rmse_m", "rpe_rmse_m", "rpe_rmse_rad"):
            assert one[name] == pytest.approx(other[name], rel=1e-3, abs=1e-6)
    assert (
        by_tum["nees"] is not None
        and not json.loads(teamslam("score", place / "run", place / "truth", "--json").out)["is_map"]
    )


def test_an_estimate_of_another_program_is_scored_as_evo_does(teamslam, place: Path, tmp_path: Path) -> None:
    """One way against another: ATE and RPE are evo's, on files that evo reads."""
    interface, metrics = pytest.importorskip("evo.tools.file_interface"), pytest.importorskip("evo.core.metrics")
    truth, estimate = place / "truth" / "red.tum", place / "run" / "tum" / "red.tum"
    part = scored(teamslam, estimate, truth)
    assert part["chi2"] is None and part["nees"] is None
    true, found = (interface.read_tum_trajectory_file(str(path)) for path in (truth, estimate))
    relative = metrics.RPE(metrics.PoseRelation.translation_part, 1.0, metrics.Unit.frames)
    relative.process_data((true, found))
    (robot,) = part["robots"]
    assert robot["rpe_rmse_m"] == pytest.approx(relative.get_statistic(metrics.StatisticsType.rmse), rel=1e-3)
    found.align(true)
    absolute = metrics.APE(metrics.PoseRelation.translation_part)
    absolute.process_data((true, found))
    assert robot["ate_rmse_m"] == pytest.approx(absolute.get_statistic(metrics.StatisticsType.rmse), rel=1e-3)


def test_truth_at_other_stamps_is_interpolated(teamslam, place: Path, tmp_path: Path) -> None:
    """Samples half a second before and after each pose, on the line between: the truth there is the truth."""
    for name in ("red", "blue"):
        stamps, poses = read_trajectory(place / "truth" / f"{name}.tum")
        steps = poses[1:].minus(poses[:-1])
        middle = poses[:-1].retract(0.5 * steps)
        finer = np.sort(np.concatenate([stamps, stamps[:-1] + 0.5]))
        both = type(poses)(
            np.concatenate([poses.rotation, middle.rotation]), np.concatenate([poses.translation, middle.translation])
        )
        order = np.argsort(np.concatenate([stamps, stamps[:-1] + 0.5]))
        write_trajectory(tmp_path / f"{name}.tum", finer, both[order])
        assert len(finer) == 2 * len(stamps) - 1
    coarse, fine = scored(teamslam, place / "run", place / "truth"), scored(teamslam, place / "run", tmp_path)
    assert coarse["robots"] == [pytest.approx(robot) for robot in fine["robots"]]
    stamps, poses = read_trajectory(place / "truth" / "red.tum")
    write_trajectory(tmp_path / "red.tum", stamps[::3], poses[np.arange(0, len(stamps), 3)])
    (tmp_path / "blue.tum").unlink()
    (robot,) = scored(teamslam, place / "run", tmp_path)["robots"]
    assert robot["poses"] == len(stamps[::3])  # three seconds lie between samples: nothing is made up there


def test_a_csv_of_places_gives_the_error_of_every_landmark(teamslam, place: Path, tmp_path: Path) -> None:
    log = ts.read(place / "log")
    keys, dim = log.landmark_keys, log.truth.layout.kinds[log.truth.layout.index(log.landmark_keys)].max() % 2 + 2
    places = log.truth.positions(keys, int(dim))
    with (tmp_path / "marks.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["landmark", *"xyz"[: int(dim)]])
        out.writerows([int(key), *row] for key, row in zip(keys, places.tolist(), strict=True))
    part = scored(teamslam, place / "run", tmp_path / "marks.csv")
    assert len(part["landmarks"]) == len(keys) and not part["robots"]
    errors = [mark["position_m"] for mark in part["landmarks"]]
    assert part["landmark_rmse_m"] == pytest.approx(float(np.sqrt(np.mean(np.square(errors)))))
    worst = max(part["landmarks"], key=lambda mark: mark["position_m"])
    told = teamslam("score", place / "run", tmp_path / "marks.csv").out
    assert f"landmarks farthest off   {worst['landmark']} {worst['position_m']:.4f} m" in told


def test_a_csv_of_poses_says_what_tum_says(teamslam, place: Path, tmp_path: Path) -> None:
    with (tmp_path / "robots.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["robot", "stamp", "x", "y", "z", "qw", "qx", "qy", "qz"])
        for name in ("red", "blue"):
            stamps, poses = read_trajectory(place / "truth" / f"{name}.tum")
            out.writerows([name, stamp, *row] for stamp, row in zip(stamps, poses.numbers().tolist(), strict=True))
    by_csv, by_tum = (
        scored(teamslam, place / "run", tmp_path / "robots.csv"),
        scored(teamslam, place / "run", place / "truth"),
    )
    for one, other in zip(by_csv["robots"], by_tum["robots"], strict=True):
        assert {k: v for k, v in one.items() if k != "robot"} == pytest.approx(
            {k: v for k, v in other.items() if k != "robot"}
        )


def test_a_map_without_error_has_none(teamslam, place: Path) -> None:
    part = scored(teamslam, place / "truth", place / "truth")
    assert part["robot_position_rmse_m"] == pytest.approx(0.0, abs=1e-9) and len(part["robots"]) == 2


def test_robots_that_nobody_knows_are_told(teamslam, place: Path, tmp_path: Path) -> None:
    for name in ("green", "white"):
        (tmp_path / f"{name}.tum").write_text((place / "truth" / "red.tum").read_text())
    called = teamslam("score", place / "run", tmp_path)
    assert called.code == 2 and "robots green, white, the map of red, blue" in called.err and "its file" in called.err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot,stamp,x,y\nred,0,1,2\n", "expected the columns x, y, theta"),
        ("robot,stamp,x,y,theta\nred,0,1,2,0\nred,0,1,2,0\n", "line 3, field 'stamp': this stands in the file already"),
        ("robot,stamp,x,y,theta\nred,-1,1,2,0\n", "line 2, field 'stamp'"),
        ("landmark,x,y\n", "holds no row"),
        ("landmark,x,y\n1,2,far\n", "line 2, field 'y'"),
    ],
)
def test_a_truth_that_cannot_be_read_names_the_line(teamslam, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "truth.csv").write_text(text)
    called = teamslam("score", tmp_path / "truth.csv", tmp_path / "truth.csv")
    assert called.code == 2 and words in called.err


def test_a_truth_in_a_logs_folder_is_read_as_the_log_reads_it(teamslam, place: Path) -> None:
    """As the help says it: a run against the file of true poses that lies beside the log; another file is refused."""
    of_robots = teamslam("score", place / "run", place / "log" / "truth_robots.csv", "--json")
    of_log = teamslam("score", place / "run", place / "log", "--json")
    one, other = (json.loads(called.out)["components"][0]["robots"] for called in (of_robots, of_log))
    assert [r["ate_rmse_m"] for r in one] == pytest.approx([r["ate_rmse_m"] for r in other], rel=1e-6) and len(one) == 2
    called = teamslam("score", place / "run", place / "log" / "odometry_red.csv")
    assert called.code == 2 and "odometry_red.csv" in called.err


def test_what_a_command_does_not_take_is_named(teamslam) -> None:
    called = teamslam("score", "a", "b", "c", "d")
    assert called.code == 2 and "does not take c and d" in called.err and "Token" not in called.err
