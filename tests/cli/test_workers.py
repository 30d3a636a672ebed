"""`--workers`: the same map by a tree on several processes, and what is left of it beside the output."""

import json
from pathlib import Path

import pytest

from teamslam.io import write, write_submaps
from teamslam.joining import build, split
from worlds import team

POSES_PER_PIECE = 6


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small team's log with truth, and beside it how to cut it and its submaps."""
    path = tmp_path_factory.mktemp("team") / "log"
    dataset = team("2d", robots=3, poses=12)
    write(dataset, path, "plain")
    path.with_name("short.toml").write_text(f"[split]\nposes_per_piece = {POSES_PER_PIECE}\n", encoding="utf-8")
    pieces = split(dataset, poses_per_piece=POSES_PER_PIECE)
    write_submaps([build(piece) for piece in pieces], path.with_name("submaps"))
    return path


@pytest.mark.parametrize("command", ["run", "join"])
def test_on_workers_it_is_the_same_map(teamslam, log: Path, tmp_path: Path, command: str) -> None:
    inputs = {
        "run": [log, "--config", log.with_name("short.toml")],
        "join": [log.with_name("submaps"), "--truth", log],
    }
    reports = []
    for out, workers in (("one", []), ("two", ["--workers", "2"])):
        called = teamslam(command, *inputs[command], "--out", tmp_path / out, "--no-figures", *workers)
        assert called.code == 0, called.err
        reports.append(json.loads((tmp_path / out / "report.json").read_text()))
        assert not (tmp_path / f"{out}.parts").exists()
    one, two = reports
    costs = ("cost", "chi2", "join_cost") if command == "run" else ("join_cost",)
    for field in (*costs, "robot_position_rmse_m", "landmark_rmse_m", "nees_per_dof"):
        assert two[field] == pytest.approx(one[field], rel=1e-6), field
    for field in ("dof", "submaps", "poses", "landmarks", "components"):
        assert two[field] == one[field], field


@pytest.mark.parametrize(
    ("asked", "reason"),
    [(["--workers", "2", "--cluster", "tcp://nowhere:1"], "not both"), (["--workers", "2", "--exact"], "one process")],
)
def test_what_does_not_go_together_is_refused(
    teamslam, log: Path, tmp_path: Path, asked: list[str], reason: str
) -> None:
    called = teamslam("run", log, "--out", tmp_path / "out", *asked)
    assert called.code == 2 and reason in called.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["run", "join"])
def test_where_no_scheduler_answers_nothing_is_left_behind(teamslam, log: Path, tmp_path: Path, command: str) -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    inputs = {"run": log, "join": log.with_name("submaps")}
    called = teamslam(command, inputs[command], "--out", tmp_path / "out", "--cluster", "nowhere")
    assert called.code == 2 and "no dask scheduler answers at nowhere" in called.err
    assert list(tmp_path.iterdir()) == []
