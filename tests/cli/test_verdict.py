"""Every run says whether the model fits, and a gross misfit ends with its own code."""

import json
from pathlib import Path

import pytest

from faults import negated_angle, plant
from teamslam.io import write
from worlds import team


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    """A log with the sightings of one robot mirrored."""
    write(plant(team("2d", poses=20), negated_angle, source="landmarks", robots=(2,)), tmp_path / "wrong", "plain")
    return tmp_path / "wrong"


def test_a_good_log_fits_in_one_line(teamslam, tmp_path: Path) -> None:
    """And with code 0."""
    write(team("2d"), tmp_path / "log", "plain")
    called = teamslam("run", tmp_path / "log", "--out", tmp_path / "map", "--no-figures")
    assert called.code == 0
    assert "the model fits: the cost is " in called.out and "most of it" not in called.out
    fit = json.loads((tmp_path / "map" / "report.json").read_text())["fit"]
    assert (fit["verdict"], fit["gross"], fit["causes"], fit["carriers"]) == ("fits", False, [], [])
    assert fit["band"][0] <= fit["cost"] <= fit["band"][1]


@pytest.mark.parametrize("options", [(), ("--exact",), ("--method", "full")], ids=str)
def test_a_wrong_log_ends_with_code_3_and_where_to_look(teamslam, wrong: Path, tmp_path: Path, options) -> None:
    """The map is written all the same, with its verdict."""
    called = teamslam("run", wrong, "--out", tmp_path / "map", "--no-figures", *options)
    assert called.code == 3
    assert "THE MODEL DOES NOT FIT" in called.out and "robot 2: " in called.out
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert report["fit"]["gross"] and report["converged"] and report["components"] == 1
    assert (tmp_path / "map" / "residuals.csv").exists()


def test_a_join_of_files_knows_no_verdict_without_their_pieces(teamslam, wrong: Path, tmp_path: Path) -> None:
    """With them it is that of the run, by the noise as it is stated: what a piece alone puts right, a team need not."""
    pieces, submaps = tmp_path / "pieces", tmp_path / "submaps"
    assert teamslam("split", wrong, "--out", pieces).code == 0
    assert teamslam("build", pieces, "--out", submaps, "--no-calibrate").code == 0
    blind = teamslam("join", submaps, "--out", tmp_path / "blind", "--no-figures")
    assert blind.code == 0 and "the measurements are not at hand; --pieces brings them" in blind.out
    called = teamslam("join", submaps, "--out", tmp_path / "seeing", "--pieces", pieces, "--no-figures")
    assert called.code == 3
    teamslam("run", wrong, "--out", tmp_path / "run", "--no-figures", "--no-calibrate")
    seeing, run = (json.loads((tmp_path / n / "report.json").read_text())["fit"] for n in ("seeing", "run"))
    assert seeing["cost"] == pytest.approx(run["cost"]) and seeing["expected"] == pytest.approx(run["expected"])
