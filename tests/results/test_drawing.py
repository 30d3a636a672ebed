"""Figures and the page drawn beside the writing are those drawn after it, and what goes wrong with them comes back."""

import multiprocessing
from dataclasses import replace
from pathlib import Path

import pytest

from teamslam.config import Config
from teamslam.pipeline import Result
from teamslam.results import Record, drawing
from teamslam.results.drawing import draw_all


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_same_figures(result: Result, tmp_path: Path) -> None:
    """Also where the other process was killed before it had anything to give."""
    record = Record.of(result)
    expected = [path.relative_to(tmp_path / "after") for path in draw_all(record, Config(), tmp_path / "after")]
    for name, killed in (("beside", False), ("alone", True)):
        with drawing(record, Config()) as into:
            for child in multiprocessing.active_children() if killed else ():
                child.kill()
                child.join()
            files = into(tmp_path / name)
        assert files == [tmp_path / name / file for file in expected]
        assert contents(tmp_path / name) == contents(tmp_path / "after")
    assert not multiprocessing.active_children()


def test_what_cannot_be_drawn_is_raised_when_figures_are_asked_for(result: Result, tmp_path: Path) -> None:
    torn = replace(Record.of(result), report={})
    with drawing(torn, Config()) as into, pytest.raises(KeyError, match="parts"):
        into(tmp_path / "run")
    with drawing(torn, Config()):
        pass
    assert not (tmp_path / "run").exists() and not multiprocessing.active_children()
