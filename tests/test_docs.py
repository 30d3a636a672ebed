"""The pages name every format, sensor, loss and command that there is, and link only to what exists."""

import doctest
import re
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from teamslam.cli.app import app
from teamslam.io import FORMATS, SUBMAP_FORMATS
from teamslam.model import LOSSES, MODELS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"])
MARKDOWN = MarkdownIt("commonmark").enable("table")

sys.path.insert(0, str(ROOT / "scripts"))
import pages  # noqa: E402


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
    """To a file that is there, and to a heading that is in it."""
    for target, _, heading in links(page):
        if not target.startswith("http"):
            other = page.parent / target if target else page
            assert other.exists(), target
            assert not heading or heading in headings(other), f"{target}#{heading}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_of_the_code_that_a_page_names_are_there(page: Path) -> None:
    """By their path from the repository's root, from the package, the tests, or the page."""
    rooms = (ROOT, ROOT / "src", ROOT / "src" / "teamslam", ROOT / "tests", page.parent)
    for name in re.findall(r"`([\w.-]+/[\w./-]*\.(?:py|cpp|hpp|h))`", page.read_text(encoding="utf-8")):
        assert any((room / name).exists() for room in rooms), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_plain_renderer_shows_no_directive(page: Path) -> None:
    """Every page reads as Markdown in the repository: nothing in it is for one program that builds it."""
    for token in MARKDOWN.parse(page.read_text(encoding="utf-8")):
        assert not (token.type == "fence" and token.info.startswith("{")), token.content[:80]
        for part in token.children or [token]:
            if part.type == "text":
                assert not re.search(r"^(:::|\.\. \w+::)|\{\w+(:\w+)?\}$", part.content), part.content
    assert not re.search(r"^```\{|^:::", page.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_what_a_page_takes_from_docstrings_is_as_they_say(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert pages.written(text) == text, f"run: python scripts/pages.py (it writes docs/{page.name} anew)"


def test_every_page_is_in_the_contents() -> None:
    listed = {(ROOT / "docs" / target).resolve() for target, _, _ in links(ROOT / "docs" / "index.md")}
    assert {page.resolve() for page in (ROOT / "docs").rglob("*.md") if page.name != "index.md"} <= listed


def test_every_threat_names_tests_that_exist() -> None:
    lines = [
        line for line in (ROOT / "docs" / "threats.md").read_text(encoding="utf-8").splitlines() if line.startswith("|")
    ]
    written = (path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    known = set(re.findall(r"def (test_\w+)", "".join(written)))
    guarded = [
        line for line in lines if len(line.split("|")) == 5 and not line.startswith(("|---", "| who", "| what it"))
    ]
    assert len(guarded) > 10
    for line in guarded:
        named = re.findall(r"`(test_\w+)`", line.split("|")[3])
        assert named and known.issuperset(named), line


def test_examples_of_the_api_give_what_they_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sessions of docs/api.md, one after another."""
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(
        r"^```pycon\n(.*?)^```$", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.DOTALL | re.M
    )
    session = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, "docs/api.md", "docs/api.md", 0)
    report: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    runner.run(session, out=report.append)
    assert len(blocks) > 10 and not runner.failures, "".join(report)


def links(page: Path) -> list[tuple[str, str, str]]:
    """What a page links to: file, "#", heading."""
    inline = [part for token in MARKDOWN.parse(page.read_text(encoding="utf-8")) for part in token.children or []]
    found = [part.attrGet("href") or part.attrGet("src") for part in inline if part.type in ("link_open", "image")]
    return [str(target).partition("#") for target in found]


def headings(page: Path) -> set[str]:
    """What a page's headings are called in links, as public hosts of repositories have it."""
    tokens = MARKDOWN.parse(page.read_text(encoding="utf-8"))
    texts = [after.content for token, after in pairwise(tokens) if token.type == "heading_open"]
    return {re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in texts}
