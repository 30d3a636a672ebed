"""The benchmark command runs and says what it promises. Nothing is timed; peers are optional."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from thinned import thinned

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("dim", [2, 3])
def test_the_small_benchmark_runs(dim: int, tmp_path: Path) -> None:
    out = tmp_path / "small.json"
    command = [sys.executable, "benchmarks/run.py", "--size", "small", "--dim", str(dim), "--rounds", "1"]
    command += ["--solvers", "teamslam,gtsam,g2opy", "--json", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(out.read_text())
    ours = next(row for row in report["rows"] if row["solver"] == "teamslam")
    for part in ("build_ms", "solve_ms", "total_ms", "marginals_ms", "peak_mb", "chi2"):
        assert isinstance(ours[part], float)
    assert ours["same_optimum"]
    assert {row["solver"] for row in report["rows"]} | set(report["absent"]) == {"teamslam", "gtsam", "g2opy"}


@pytest.mark.parametrize("preset", thinned(2, ["2d", "planar"]))
def test_from_log_to_map_has_a_row_for_every_stage(preset: str, tmp_path: Path) -> None:
    out = tmp_path / "rows.json"
    command = [sys.executable, "benchmarks/log_to_map.py", "--preset", preset, "--poses", "60", "--json", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(out.read_text())
    ours = {row["stage"] for row in report["rows"] if row["tool"] == "teamslam" and "stage" in row}
    assert ours >= {"read", "split", "join", "exactness", "score", "write", "figures"}
    totals = {row["tool"]: row for row in report["rows"] if "total" in row}
    assert totals["teamslam"]["total"] > 0.0 and totals["teamslam"]["cost"] > 0.0
    by_hand = {"pandas + GTSAM", "pandas + Ceres", "pandas + g2o"}
    alone = {"teamslam run", "teamslam, solve alone"}
    assert set(totals) | set(report["absent"]) == {"teamslam", *alone, *by_hand}
    assert totals["teamslam run"]["cost"] == pytest.approx(totals["teamslam"]["cost"], rel=1e-6)
    assert totals["teamslam, solve alone"]["cost"] <= totals["teamslam"]["cost"]
    for tool in by_hand & set(totals):
        assert totals[tool]["cost"] == pytest.approx(totals["teamslam"]["cost"], rel=0.01)
    for tool in by_hand & set(totals) - {"pandas + GTSAM"}:  # full least squares of the same cost
        assert totals[tool]["cost"] <= totals["teamslam"]["cost"]


def test_joins_stand_beside_full_least_squares(tmp_path: Path) -> None:
    out = tmp_path / "rows.json"
    command = [sys.executable, "benchmarks/joining.py", "--poses", "80", "--repetitions", "1", "--json", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = json.loads(out.read_text())["rows"]
    for log in {row["log"] for row in rows}:
        cost = {row["what"]: row["cost"] for row in rows if row["log"] == log}
        assert cost["join"] == pytest.approx(cost["join, whole"], rel=1e-9)
        assert cost["full, all"] == pytest.approx(cost["full, solve"], rel=1e-9)
        assert cost["full, solve"] <= cost["join"]


def test_mapping_while_driving_stands_beside_smoothers(tmp_path: Path) -> None:
    pytest.importorskip("gtsam")
    out = tmp_path / "rows.json"
    command = [sys.executable, "benchmarks/online.py", "--poses", "160", "--landmarks", "30", "--dims", "2"]
    done = subprocess.run([*command, "--json", str(out)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = {row["solver"]: row for row in json.loads(out.read_text())["rows"]}
    assert set(rows) == {"teamslam", "isam2", "fixed_lag"}
    assert rows["teamslam"]["online_rmse_m"] <= 1.05 * rows["isam2"]["online_rmse_m"]


def test_corners_are_told_as_they_come_and_who_does_not_end_is_absent(tmp_path: Path) -> None:
    out = tmp_path / "rows.json"
    command = [sys.executable, "benchmarks/corners.py", "--frames", "60", "--tags", "12", "--rounds", "1"]
    command += ["--solvers", "teamslam", "--json", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(out.read_text())["rows"]
    assert row["solver"] == "teamslam" and row["tags_mm"] < 30.0
    done = subprocess.run([*command, "--limit", "0.001"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(out.read_text())
    assert report["absent"] == {"teamslam": "no result in 0.001 s of processors"} and not report["rows"]
    assert "teamslam: no result in 0.001 s of processors" in done.stdout
