"""residuals.csv holds every row once, with the names that people use, and gives back what was written."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.joining import full
from teamslam.model import Dataset, Loss, Names
from teamslam.pipeline import Result, run
from teamslam.results import Record, read_run, with_residuals, write_run
from teamslam.results.residuals import read_residuals, residuals_of, write_residuals
from teamslam.trust import verdict
from worlds import team

ODD = Names({1: 'a, "b" 100%', 2: "two"}, {0: "x%s", 1: "new\nline", 2: ""}, tick_s=1.0)


def named(names: Names, **options: object) -> Dataset:
    """A small team by other names."""
    return replace(team("planar", robots=2, **options), names=names)  # type: ignore[arg-type]


def test_every_row_stands_there_once_and_is_the_tables(result: Result, tmp_path: Path) -> None:
    """Rows by robot, source and number; whitened residuals to the digits written."""
    write_run(result, tmp_path / "run", figures=False)
    with (tmp_path / "run" / "residuals.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    values = result.map.all_values
    names = result.dataset.names
    for table in result.dataset.tables:
        mine = [r for r in rows if (r["robot"], r["source"]) == (names.robot(table.robot), table.source)]
        assert [int(r["row"]) for r in mine] == table.ids.tolist()
        parts = table.row.residual_rows(table.dim)
        found = [[float(r[f"u_{n + 1}"]) for n in range(parts)] for r in mine]
        np.testing.assert_allclose(found, table.whitened(values), rtol=1e-4, atol=1e-9)
        stamps = names.stamps_s(table.keys.max(1) if table.source == "odometry" else table.keys[:, 0])
        np.testing.assert_allclose([float(r["stamp_s"]) for r in mine], stamps, atol=1e-6)
        assert all(not r[f"u_{parts + 1}"] for r in mine if f"u_{parts + 1}" in r)
    assert len(rows) == sum(map(len, result.dataset.tables))


def test_names_of_any_kind_come_back(tmp_path: Path) -> None:
    """Commas, quotes, per cents, line breaks, nothing at all."""
    log = named(ODD).with_loss(Loss("cauchy", 1.0))
    found = residuals_of(verdict(log, full(log)))
    write_residuals(found, tmp_path / "residuals.csv")
    again = read_residuals(tmp_path / "residuals.csv")
    assert len(found) == len(again)
    for mine, theirs in zip(found, again, strict=True):
        for name in ("component", "robot", "source", "model"):
            assert getattr(mine, name) == getattr(theirs, name)
        assert [mine.targets[n] for n in mine.target] == [theirs.targets[n] for n in theirs.target]
        np.testing.assert_array_equal(mine.row, theirs.row)
        np.testing.assert_allclose(mine.weight, theirs.weight, rtol=1e-3)
        np.testing.assert_allclose(mine.whitened, theirs.whitened, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(mine.stamp_s, theirs.stamp_s, atol=1e-6)
    assert {"landmark x%s", "landmark new\nline"} <= {t for part in again for t in part.targets}


def test_figures_are_drawn_from_what_was_read_back(tmp_path: Path) -> None:
    """`plot` on a run folder; what is no such table is an error that names the file."""
    write_run(run(named(Names(tick_s=1.0))), tmp_path / "run", figures=False)
    record = read_run(tmp_path / "run")
    assert record.rows == () and len(with_residuals(record, tmp_path / "run").rows) == 6
    path = tmp_path / "run" / "residuals.csv"
    path.write_text("component,robot\n1,a\n")
    with pytest.raises(InputError, match=r"residuals\.csv"):
        with_residuals(record, tmp_path / "run")
    path.unlink()
    assert with_residuals(record, tmp_path / "run") is record


def test_two_parts_of_a_team_are_told_apart(tmp_path: Path) -> None:
    """Each row has the number of the map that it belongs to."""
    log = team("2d", robots=2)
    apart = [
        replace(t, keys=t.keys + np.array([0, 100])) if t.robot == 2 and t.source == "landmarks" else t
        for t in log.tables
    ]
    log = log.with_tables(t for t in apart if t.source != "robots")
    record = Record.of(run(log))
    assert len(record.maps) == 2
    assert {(part.component, part.robot) for part in record.rows} == {(1, "1"), (2, "2")}
