"""Every table of measured figures has the command that gives them, in its section or in the head of its page.

And what a paragraph says of a page of measurements is what stands there.
"""

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


NUMBER = re.compile(r"(?<![\w.])\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
QUOTED = re.compile(rf"{FIGURE.pattern}|(?<![\w.-])\d[\d,]*(?= ms\b)|(?<![\w.-])\d+e-\d+")
IN_OTHER_UNITS = (1.0, 1e-3, 1e3, 1e-2)


def quoted(page: Path) -> Iterator[tuple[list[Path], str]]:
    """Paragraphs that send to pages of measurements and name no command of their own: those pages, and the words."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for paragraph in re.split(r"\n\n|\n(?=- )", text):
        links = re.findall(r"\(((?:docs/|\.\./)?benchmarks/\w+\.md)", paragraph)
        if links and not paragraph.lstrip().startswith("|") and not commands(paragraph.replace("`teamslam join", "`")):
            yield [page.parent / link for link in links], re.sub(r"`[^`]*`|\([^()]*\.md[^()]*\)", "", paragraph)


def stands_there(figure: str, numbers: list[float]) -> bool:
    """Whether a figure is a number there, rounded: in the same units, or a thousand or hundred times as large."""
    mantissa, _, exponent = figure.replace(",", "").partition("e")
    digits, power = len(mantissa.partition(".")[2]), int(exponent or 0)
    half = 0.5001 * 10.0 ** (power - digits)
    return any(
        abs(number * unit - float(figure.replace(",", ""))) <= half for number in numbers for unit in IN_OTHER_UNITS
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_is_said_of_a_page_of_measurements_stands_there(page: Path) -> None:
    for linked, words in quoted(page):
        there = " ".join(path.read_text(encoding="utf-8") for path in linked)
        numbers = [float(number.replace(",", "")) for number in NUMBER.findall(there)]
        for found in QUOTED.finditer(words):
            assert stands_there(found[0], numbers), f"{found[0]}: not in {', '.join(path.name for path in linked)}"


def test_a_figure_that_stands_nowhere_would_be_found() -> None:
    assert stands_there("9,012.72", [9012.719280]) and stands_there("0.06", [56.7]) and stands_there("2e-16", [1.6e-16])
    assert (
        not stands_there("14.1", [1.32]) and not stands_there("0.034", [0.0323]) and not stands_there("1e-14", [1e-13])
    )


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
