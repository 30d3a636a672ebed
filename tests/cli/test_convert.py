"""Logs go from one format to another; what gets lost is told."""

from pathlib import Path

import pytest

from teamslam.io import FORMATS, read, write
from worlds import team


def test_help_names_every_format_and_those_that_are_only_read(teamslam) -> None:
    """A new row of FORMATS is a new line of help."""
    lines = teamslam("convert", "--help").out.splitlines()
    for name, row in FORMATS.items():
        line = next(line for line in lines if line.strip().startswith(f"{name} "))
        assert ("(read only)" in line) is not row.writes


@pytest.mark.parametrize("to", [name for name, row in FORMATS.items() if row.writes])
def test_a_log_goes_through_every_format_that_is_written(teamslam, tmp_path: Path, to: str) -> None:
    """As many measurements come out as went in."""
    before = team("2d", poses=6)
    if to == "jrl":  # it has no place for points
        before = before.with_tables(t for t in before.tables if t.source != "landmarks")
    write(before, tmp_path / "log", "plain")
    called = teamslam("convert", tmp_path / "log", tmp_path / "out", "--to", to)
    assert called.code == 0 and "3 robots" in called.out
    after = read(tmp_path / "out", format=to)
    assert sum(len(t) for t in after.tables) == sum(len(t) for t in before.tables)


def test_an_output_that_is_there_is_not_written_over(teamslam, tmp_path: Path) -> None:
    """Nor is it read before the refusal."""
    (tmp_path / "out").write_text("mine")
    called = teamslam("convert", tmp_path, tmp_path / "out")
    assert called.code == 2 and "there already" in called.err
    assert (tmp_path / "out").read_text() == "mine"


def test_a_format_that_is_only_read_is_refused_with_those_that_are_written(teamslam, tmp_path: Path) -> None:
    """MRCLAM is not written."""
    write(team("2d", poses=4), tmp_path / "log", "plain")
    called = teamslam("convert", tmp_path / "log", tmp_path / "out", "--to", "mrclam")
    assert called.code == 2 and "plain" in called.err and not (tmp_path / "out").exists()
