"""A made-up team from the command line alone: simulate, look, convert, map in three ways, score, draw."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from teamslam.cli import main


def call(*arguments: object) -> int:
    """A command in this process."""
    return main([str(a) for a in arguments])


def report_of(folder: Path) -> dict[str, object]:
    """What a run says of itself."""
    return json.loads((folder / "report.json").read_text())


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated log in the plain format."""
    folder = tmp_path_factory.mktemp("story") / "log"
    assert call("simulate", folder, "--seed", 3) == 0
    return folder


@pytest.fixture(scope="module")
def runs(log: Path) -> dict[str, Path]:
    """The log mapped by joining, by exact joining and by full least squares."""
    made = {}
    for name, options in {"join": [], "exact": ["--exact"], "full": ["--method", "full"]}.items():
        made[name] = log.parent / name
        assert call("run", log, "--out", made[name], *options, "--quiet") == 0
    return made


def test_the_log_is_understood(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`info` finds robots, landmarks, truth and links."""
    assert call("info", log) == 0
    out = capsys.readouterr().out
    for word in ("robots", "landmarks", "odometry", "common landmarks", "truth"):
        assert word in out


def test_joining_comes_close_to_full_least_squares_and_exact_joining_reaches_it(runs: dict[str, Path]) -> None:
    """The paper's claim, and the project's: the cost of the exact join is that of the full problem."""
    join, exact, full = (report_of(runs[name]) for name in ("join", "exact", "full"))
    assert join["converged"] and exact["converged"] and full["converged"]
    assert exact["cost"] == pytest.approx(full["cost"], rel=1e-9)
    assert join["robot_position_rmse_m"] == pytest.approx(full["robot_position_rmse_m"], rel=0.5)
    assert exact["exactness"]["relative_cost_gap"] <= 1e-10 and exact["exactness"]["bytes"] > 0
    assert 1e-10 < join["exactness"]["relative_cost_gap"] < 1e-3
    assert join["exactness"]["max_shift_sigma"] == pytest.approx(exact["exactness"]["join_shift_sigma"], rel=0.2)
    assert full["exactness"] is None


def test_maps_are_scored_against_the_truth_and_against_each_other(
    runs: dict[str, Path], log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The truth may be a log or another run."""
    assert call("score", runs["join"], log) == 0
    assert "RMSE" in capsys.readouterr().out
    assert call("score", runs["exact"], runs["full"]) == 0
    assert "RMSE" in capsys.readouterr().out


def test_figures_are_drawn_again_in_other_types(runs: dict[str, Path], tmp_path: Path) -> None:
    """From the run folder alone."""
    assert call("plot", runs["join"], "--out", tmp_path, "--type", "svg") == 0
    assert {p.name for p in tmp_path.iterdir()} >= {"map.svg", "convergence.svg", "errors.svg", "consistency.svg"}


def test_a_run_can_be_repeated_from_its_options(runs: dict[str, Path], log: Path, tmp_path: Path) -> None:
    """The same options on the same log give the same map, to the last digit."""
    assert call("run", log, "--out", tmp_path / "again", "--config", runs["join"] / "config.toml", "--quiet") == 0
    for name in ("trajectories.csv", "landmarks.csv", "team.csv"):
        assert (tmp_path / "again" / name).read_text() == (runs["join"] / name).read_text()


def test_a_converted_log_gives_the_same_map(tmp_path: Path) -> None:
    """From the plain format to g2o."""
    assert call("simulate", tmp_path / "log", "--preset", "2d", "--seed", 5) == 0
    assert call("convert", tmp_path / "log", tmp_path / "log.g2o") == 0
    for name in ("log", "log.g2o"):
        assert call("run", tmp_path / name, "--out", tmp_path / f"{name}-full", "--method", "full", "--quiet") == 0
    plain, converted = (report_of(tmp_path / f"{name}-full") for name in ("log", "log.g2o"))
    assert converted["dof"] == plain["dof"]
    assert converted["cost"] == pytest.approx(plain["cost"], rel=1e-3)  # g2o turns translations into the other frame


def test_the_installed_command_works_as_a_process(log: Path, tmp_path: Path) -> None:
    """Exit codes and streams as a shell sees them."""
    command = [sys.executable, "-c", "import sys; from teamslam.cli import main; sys.exit(main())"]
    done = subprocess.run([*command, "run", log, "--out", tmp_path / "run"], capture_output=True, text=True)
    assert done.returncode == 0 and "robot position RMSE" in done.stdout and done.stderr == ""
    bad = subprocess.run([*command, "run", log, "--out", tmp_path / "run"], capture_output=True, text=True)
    assert bad.returncode == 2 and bad.stdout == "" and "--force" in bad.stderr and "Traceback" not in bad.stderr
