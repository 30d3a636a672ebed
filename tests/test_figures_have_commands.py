"""Every table of measured figures has the command that gives them: in its section, or in the head of its page."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMMAND = re.compile(
    r"^ *teamslam [a-z]+|(?<=`)teamslam [a-z]+|make [a-z]+|scripts/[a-z]+"
    r"|(?:python|pytest) (?:benchmarks|examples|tests)/[\w/]+\.py",
    re.MULTILINE,
)
FIGURE = re.compile(r"(?<![\w.-])\d[\d,]*\.\d+(e[-+]?\d+)?(?![\w.])")


def sections(page: Path) -> Iterator[tuple[str, str]]:
    """Heading and text of each part of a page; what stands before the first heading of the second level is its head."""
    parts = re.split(r"^(## .+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    yield "", parts[0]
    yield from zip(parts[1::2], parts[2::2], strict=True)


def commands(text: str) -> list[str]:
    """What a text says to run: in backticks, in fences, or indented."""
    code = re.findall(r"^```.*?^```|^ {4,}\S.*$|`[^`]+`", text, re.DOTALL | re.MULTILINE)
    return [command for piece in code for command in COMMAND.findall(piece)]


def measured(text: str) -> list[str]:
    """The tables in a text that hold figures: in two rows or more, with digits behind the point."""
    tables = re.findall(r"(?:^\|.*\n)+", re.sub("`[^`\n]*`", "", text) + "\n", re.MULTILINE)
    return [table for table in tables if sum(bool(FIGURE.search(row)) for row in table.split("\n")[2:]) >= 2]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_measured_figures_have_their_command(page: Path) -> None:
    head = ""
    for heading, text in sections(page):
        head = head or text
        if measured(text):
            assert commands(text) or commands(head), f"{heading or 'the head'}: say what printed this table"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_that_pages_name_are_there(page: Path) -> None:
    """Scripts lie where they are said to, and teamslam has the command."""
    from teamslam.cli.app import app

    known = {name for name in app if not name.startswith("-")}
    for command in commands(page.read_text(encoding="utf-8")):
        program, name = f"run {command}".split()[-2:]
        assert (name in known) if program == "teamslam" else program == "make" or (ROOT / name).exists(), command


def test_a_table_without_a_command_would_be_found() -> None:
    table = "| log | error |\n|---|---|\n| one | 0.034 m |\n| two | 1.5 m |\n"
    assert measured(f"Words.\n\n{table}") == [table]
    assert not commands("teamslam runs, and so on") and commands("as `teamslam run LOG` says")
    assert not measured("| a | b |\n|---|---|\n| `1.5` | x |\n| `2.5` | y |\n")
