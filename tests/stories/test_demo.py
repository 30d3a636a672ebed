"""The demo: three teams, three methods, one figure, and what to try next."""

import json
from pathlib import Path

import pytest

import worlds
from teamslam.cli import main
from teamslam.errors import MissingExtraError


def test_the_demo_shows_that_joining_is_close_and_exact_joining_equal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What it prints is true of the folders that it leaves; it may be run again over itself."""
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 0
    out = capsys.readouterr().out
    for word in ("joined", "exact", "full", "Look at", "Next", "demo.png"):
        assert word in out
    assert (tmp_path / "demo" / "demo.png").stat().st_size > 20_000
    for team in ("paper-world", "team", "film"):
        reports = {
            method: json.loads((tmp_path / "demo" / f"{team}-{method}" / "report.json").read_text())
            for method in ("joined", "exact", "full")
        }
        assert all(r["converged"] and r["components"] == 1 for r in reports.values())
        assert reports["exact"]["cost"] == pytest.approx(reports["full"]["cost"], rel=1e-9)
        assert reports["joined"]["cost"] == pytest.approx(reports["full"]["cost"], rel=0.01)


def unfilmed(seed: int, progress: object) -> None:
    """As where OpenCV is not installed."""
    raise MissingExtraError("filming needs OpenCV; install it with `pip install teamslam[tags]`")


def test_a_quiet_demo_says_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "teamslam.cli.demo.demo_teams", lambda seed: {"small": ("A small team", worlds.team(seed=seed))}
    )
    monkeypatch.setattr("teamslam.cli.demo.filmed_team", unfilmed)
    assert main(["demo", "--out", str(tmp_path / "demo"), "-q"]) == 0
    assert (tmp_path / "demo" / "demo.png").exists()
    assert capsys.readouterr() == ("", "")
