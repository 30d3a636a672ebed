"""The gallery: each script runs, says what its page says, and draws its figure; those on published data where it is."""

import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "examples" / "gallery"
IMAGES = ROOT / "docs" / "images" / "gallery"
PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
ON_DATA = {"mrclam": "mrclam_6", "victoria_park": "islsjf_vicpark_200", "tags_from_bags": "tagslam_dupont"}
SLOW = ("mrclam", "tags_from_bags", "outliers", "calibration")
SCRIPTS = [
    pytest.param(path.stem, marks=[pytest.mark.slow] if path.stem in SLOW else [])
    for path in sorted(FOLDER.glob("*.py"))
]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_case_runs_and_says_what_its_page_says(
    name: str, data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from PIL import Image

    from teamslam.model import MODELS

    if name == "tags_from_bags":
        pytest.importorskip("rosbags")
    monkeypatch.chdir(tmp_path)
    models = dict(MODELS)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *([str(data(ON_DATA[name]))] if name in ON_DATA else [])])
    try:
        runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    finally:
        MODELS.clear()
        MODELS.update(models)
    said = capsys.readouterr().out
    section = PAGE[PAGE.index(f"gallery/{name}.py") :].split("\n## ")[0]
    for line in re.search(r"```text\n(.*?)```", section, re.DOTALL)[1].strip().split("\n"):
        assert line in said, line
    with Image.open(tmp_path / f"{name}.png") as drawn, Image.open(IMAGES / f"{name}.png") as kept:
        assert drawn.width / drawn.height == pytest.approx(kept.width / kept.height, rel=0.02)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_a_case_is_short_and_on_the_page_with_its_figure(path: Path) -> None:
    assert 10 <= len(path.read_text(encoding="utf-8").split("\n")) <= 62
    assert f"(../examples/gallery/{path.name})" in PAGE and f"(images/gallery/{path.stem}.png)" in PAGE
    assert (IMAGES / f"{path.stem}.png").stat().st_size < 120_000
