"""Runs compared: the table says what their reports say, and a plain computation confirms the rest."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.cli import main
from teamslam.pipeline import run
from teamslam.results import Record
from teamslam.results.compared import COLUMNS, compared
from worlds import team


@pytest.fixture(scope="module")
def runs() -> dict[str, Record]:
    """One log, joined and by full least squares."""
    from teamslam.config import Config

    log = team("2d", sigma=0.1, sigma_odometry=0.1)
    return {"joined": Record.of(run(log)), "full": Record.of(run(log, Config(method="full")))}


def test_the_table_is_true(runs: dict[str, Record]) -> None:
    """RMSE as the reports have them; quantiles of the same errors; cost, NEES and bytes of the reports."""
    found = compared(runs)
    for row, (name, record) in zip(found.rows, runs.items(), strict=True):
        cells, errors = dict(zip(COLUMNS, row, strict=True)), found.clouds[name].every
        assert cells["run"] == name
        assert float(cells["RMSE [m]"]) == pytest.approx(record.report["robot_position_rmse_m"], abs=6e-5)
        assert float(cells["landmarks' RMSE [m]"]) == pytest.approx(record.report["landmark_rmse_m"], abs=6e-5)
        assert float(cells["worst"]) == pytest.approx(errors.max(), abs=6e-5)
        assert float(cells["95 % below"]) == pytest.approx(np.quantile(errors, 0.95), abs=6e-5)
        assert float(cells["cost"]) == pytest.approx(record.report["cost"], rel=1e-5)


def test_without_truth_the_first_stands_for_it(runs: dict[str, Record]) -> None:
    """And the others' differences from it are what is compared."""
    bare = {name: replace(record, truth=None) for name, record in runs.items()}
    found = compared(bare)
    assert "joined" in found.basis and list(found.clouds) == ["full"]
    assert 0.0 < found.clouds["full"].every.max() < 0.05
    assert found.rows[0][1] == "-"


def test_plot_compares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs from the command line: a table, a figure, a CSV; one run: maps coloured, from a side."""
    from teamslam.io import write

    write(team("2d"), tmp_path / "log", "plain")
    for method in ("join", "full"):
        arguments = ["run", str(tmp_path / "log"), "--out", str(tmp_path / method), "--method", method, "-q"]
        assert main([*arguments, "--no-figures"]) == 0
    both = ["plot", str(tmp_path / "join"), str(tmp_path / "full")]
    assert main([*both, "--out", str(tmp_path / "both")]) == 0
    assert "after one alignment of the team" in capsys.readouterr().out
    with (tmp_path / "both" / "comparison.csv").open(newline="") as file:
        assert [row["run"] for row in csv.DictReader(file)] == both[1:]
    assert (tmp_path / "both" / "comparison.png").stat().st_size > 10_000
    for wrong, said in (([], "--out DIR"), (["--out", "x", "--side", "top"], "one run")):
        assert main([*both, *wrong]) == 2 and said in capsys.readouterr().err
    assert main(["plot"]) == 2 and "name a run" in capsys.readouterr().err
    assert main(["plot", str(tmp_path / "join"), "--side", "front"]) == 0
    names = {path.name for path in (tmp_path / "join" / "figures").iterdir()}
    assert names >= {"map.png", "map_from_side.png", "map_errors.png", "map_residuals.png"}
    assert (tmp_path / "join" / "report.html").exists()
