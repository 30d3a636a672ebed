"""The pages name every format, sensor, loss and command that there is, and link only to what exists."""

import re
from pathlib import Path

import pytest

from teamslam.cli.app import app
from teamslam.io import FORMATS, SUBMAP_FORMATS
from teamslam.model import LOSSES, MODELS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])


@pytest.mark.parametrize("name", [*FORMATS, *SUBMAP_FORMATS])
def test_every_format_is_described(name: str) -> None:
    assert f"`{name}`" in (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", MODELS)
def test_every_sensor_is_described(name: str) -> None:
    words = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8").lower()
    assert all(word in words for word in name.split("_"))


@pytest.mark.parametrize("name", LOSSES)
def test_every_loss_is_described(name: str) -> None:
    assert f"| {name} |" in (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")


def test_every_command_is_described() -> None:
    headings = re.findall(r"^## (\w+)$", (ROOT / "docs" / "cli.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(headings) == sorted(name for name in app if not name.startswith("-"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target
