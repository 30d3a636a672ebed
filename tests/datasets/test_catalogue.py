"""The public data sets: each row says all that one needs, and the pages use no set that is not among them."""

import re
from pathlib import Path

import pytest

from teamslam.datasets import PublicSet, by_name, public_sets
from teamslam.errors import InputError
from teamslam.io import FORMATS

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]


@pytest.mark.parametrize("found", public_sets(), ids=lambda found: found.name)
def test_a_set_says_whose_it_is_and_where_and_how_to_map_it(found: PublicSet) -> None:
    assert re.match(r"https?://[\w.-]+\.\w+/", found.page) and found.by and found.licence and found.get
    assert found.format in FORMATS
    assert all(command.startswith("teamslam ") and "{path}" not in command for command in found.commands("data"))
    assert all(re.fullmatch("[0-9a-f]{64}", digest) for digest in found.sha256.values())
    assert bool(found.sha256) == (found.bytes is not None)


def test_names_are_told_apart() -> None:
    names = [found.name for found in public_sets()]
    assert len(set(names)) == len(names)
    with pytest.raises(InputError, match="did you mean 'mrclam_6'"):
        by_name("mrclam-6")


def test_every_set_that_the_pages_name_is_listed() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    known = " ".join(f"{s.folder} {s.file} {s.command} {list(s.sha256)}" for s in public_sets())
    used = set(re.findall(r"MRCLAM_Dataset\d|\b[\w-]+\.(?:pyfg|mat)\b|VicPark_\w+maps|parking-garage", text))
    examples = {"team.pyfg", "graphs.pyfg"} | {f"localmap_{number}.mat" for number in range(10)}
    assert {name for name in used - examples if name not in known} == set()


def test_every_set_has_a_row_on_its_page() -> None:
    page = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    for found in public_sets():
        assert f"`{found.name}`" in page or found.name.startswith("mrclam_"), found.name
        assert found.page in page
