"""The paper's tables and figures by one command."""

import json
from pathlib import Path

import pytest

from teamslam.cli import main
from teamslam.paper.reproduction import PRINTED


def test_tables_stand_beside_the_papers_figures_and_figures_are_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All six cells of both tables, what the paper printed, the bound, the caveats, and three figures."""
    assert main(["paper", "--runs", "2", "--poses", "4", "--out", str(tmp_path / "paper")]) == 0
    said = capsys.readouterr().out
    for words in ("Table 1 (minimum)", "Table 2 (sufficient)", "sqrt of bound", "cannot be compared"):
        assert words in said
    for nlls, joined in PRINTED.values():
        assert f"{nlls.state:.4f}" in said and f"{joined.landmark:.4f}" in said
    tables = json.loads((tmp_path / "paper" / "tables.json").read_text())
    assert len(tables["cells"]) == 6
    assert {p.name for p in (tmp_path / "paper").iterdir()} == {
        "figure_2.png", "figure_3.png", "figure_4.png", "tables.json", "tables.txt",
    }  # fmt: skip


def test_no_run_at_all_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is written."""
    assert main(["paper", "--runs", "0", "--out", str(tmp_path / "paper")]) == 2
    assert "at least one run" in capsys.readouterr().err and not (tmp_path / "paper").exists()
