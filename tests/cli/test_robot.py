"""`teamslam robot`: a log played row by row; submaps as they close, poses as they are known at the time."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from teamslam.io import read, read_submaps, write
from teamslam.joining import build, split
from teamslam.wire.messages import canonical
from worlds import team


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small team's log with truth."""
    path = tmp_path_factory.mktemp("team") / "log"
    write(team("2d", robots=2, poses=30, landmarks=6, sees=0.6), path, "plain")
    return path


def test_its_submaps_are_those_that_build_makes(teamslam, log: Path, tmp_path: Path) -> None:
    called = teamslam("robot", log, "--robot", 2, "--out", tmp_path / "two", "--poses-per-piece", 8)
    assert called.code == 0 and "30 poses, 4 submaps" in called.out
    pieces = split(read(log).of_robot(2), poses_per_piece=8)
    live = read_submaps(tmp_path / "two" / "submaps")
    assert sorted(map(canonical, live)) == sorted(canonical(build(piece)) for piece in pieces)


def test_poses_are_there_from_the_first_moment_on(teamslam, log: Path, tmp_path: Path) -> None:
    assert teamslam("robot", log, "--robot", 1, "--out", tmp_path / "one", "--poses-per-piece", 8).code == 0
    with (tmp_path / "one" / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    stamps = [float(row["stamp_s"]) for row in rows]
    assert stamps == sorted(stamps) and len(rows) == 30 and {row["frame"] for row in rows} == {"1"}
    truth = read(log).truth
    assert truth is not None
    poses = truth.poses_of(read(log).pose_keys[1], 2)
    way = poses[0].between(poses).translation
    found = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
    sigmas = np.array([np.sqrt(float(row["cov_x_x"]) + float(row["cov_y_y"])) for row in rows])
    assert (np.linalg.norm(found - way, axis=1) <= 4.0 * sigmas + 1e-9).all()


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        ((), "several robots (1, 2); say which with --robot"),
        (("--robot", "9"), "no robot '9'; it is of: 1, 2"),
        (("--robot", "1", "--speed", "0"), "a speed is above 0"),
        (("--robot", "1", "--poses-per-piece", "1"), "at least 2 poses"),
    ],
)
def test_calls_that_make_no_sense_are_refused_and_leave_nothing(
    teamslam, log: Path, tmp_path: Path, extra: tuple[str, ...], says: str
) -> None:
    called = teamslam("robot", log, "--out", tmp_path / "out", *extra)
    assert called.code == 2 and says in called.err and not (tmp_path / "out").exists()


def test_on_a_disk_that_fills_it_maps_on_says_so_and_loses_nothing(log: Path, tmp_path: Path) -> None:
    """No file may grow beyond some kilobytes, which is too little for its poses and its journal. It says so, and makes
    its submaps all the same; once there is room it goes on from what its journal had."""
    resource = pytest.importorskip("resource")  # not on Windows
    command = [sys.executable, "-m", "teamslam", "robot", str(log), "--robot", "2", "--out", str(tmp_path / "two")]
    command += ["--poses-per-piece", "8", "--resume"]

    def tight() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))

    full = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=tight)
    assert full.returncode == 1 and full.stderr.count("teamslam:") == 1, full.stderr
    assert "journal.db" in full.stderr and "records wait in memory" in full.stderr
    pieces = split(read(log).of_robot(2), poses_per_piece=8)
    best = sorted(canonical(build(piece)) for piece in pieces)
    assert sorted(map(canonical, read_submaps(tmp_path / "two" / "submaps"))) == best
    room = subprocess.run(command, capture_output=True, text=True, check=False)
    assert room.returncode == 0 and not room.stderr
    assert sorted(map(canonical, read_submaps(tmp_path / "two" / "submaps"))) == best
