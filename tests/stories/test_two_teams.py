"""Robots that nothing connects come out as two maps, with the reason in words and exit code 1."""

import csv
import json
from pathlib import Path

import pytest

from teamslam.cli import main
from teamslam.io import write
from worlds import apart, team


def test_what_cannot_be_joined_is_mapped_apart_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Both maps are written and drawn; the reason names the robot and the cure; scripts see code 1."""
    write(apart(), tmp_path / "log", "plain")
    assert main(["run", str(tmp_path / "log"), "--out", str(tmp_path / "run")]) == 1
    said = capsys.readouterr().out
    assert "could not be joined" in said and "robot 3" in said
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert report["components"] == 2 and report["converged"] and len(report["reasons"]) == 1
    assert {p.name for p in (tmp_path / "run" / "figures").iterdir()} >= {"map.png", "map_2.png"}
    with (tmp_path / "run" / "team.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["component"], row["robot"]) for row in rows] == [("1", "1"), ("1", "2"), ("2", "3")]


def test_a_single_robot_is_a_team_too(tmp_path: Path) -> None:
    """One submap, nothing to join, all the same files."""
    write(team("2d", robots=1, poses=12), tmp_path / "log", "plain")
    assert main(["run", str(tmp_path / "log"), "--out", str(tmp_path / "run"), "--quiet"]) == 0
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert report["components"] == 1 and report["robots"] == 1 and "nothing to join" in report["status"]
    assert (tmp_path / "run" / "figures" / "map.png").exists()
