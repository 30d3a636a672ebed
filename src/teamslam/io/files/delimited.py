"""Columns of numbers and words from text files, every cell with its place: errors name file, line and field.

Two shapes of file: columns between blanks with `#` comments (`read_columns`), and CSV with a header as spreadsheets and
pandas write it (`read_csv`: comma, semicolon or tab, quotes, a byte-order mark).

Plain files, which are nearly all, are read at once (`grid`). The others (quotes, comments between the rows, numbers
like `+1` or `.5`, damage) are gone through cell by cell, which gives the same, or says what is wrong and where.
"""

import codecs
import csv
import io
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray
from teamslam.io.files.csv_file import Csv, finite_numbers
from teamslam.io.files.grid import between_blanks, separated


def read_text(path: Path) -> str:
    """The whole of a text file (UTF-8, with or without a byte-order mark). InputError where it is absent or no text."""
    content = _read_bytes(path)
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is no text; expected a text file (UTF-8)", path=path) from None
    if "\0" in text:
        raise InputError("holds bytes of value 0; expected a text file (UTF-8)", path=path)
    return text


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes().removeprefix(codecs.BOM_UTF8)
    except FileNotFoundError:
        raise InputError("no such file", path=path) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", path=path) from None


# --- columns between blanks -------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Columns:
    """Numbers (n, c) and the line (n,) each row stands on."""

    values: Array
    lines: IntArray


def read_columns(path: Path, fields: Sequence[str]) -> Columns:
    """Columns between blanks, `#` comments and empty lines left out: (n, len(fields)) finite numbers.

    InputError names the line and field of a row that is too short or too long, of a word that is no number, and of a
    number that is not finite. A file without rows gives none.
    """
    return plain_columns(_read_bytes(path), len(fields)) or any_columns(path, fields)


def plain_columns(content: bytes, columns: int) -> Columns | None:
    """A grid of numbers below comments; None where the file is not so plain."""
    if not _is_text(content):
        return None
    above, body = _below_comments(content)
    found = between_blanks(body, columns)
    if found is None:
        return None
    grid, lines = found
    numbers = grid.numbers()
    return None if numbers is None else Columns(numbers, 1 + above.count(b"\n") + lines)


def any_columns(path: Path, fields: Sequence[str]) -> Columns:
    """As `read_columns`, line by line."""
    rows, lines = [], []
    for number, line in enumerate(read_text(path).split("\n"), 1):
        cells = line.split()
        if not cells or cells[0].startswith("#"):
            continue
        if len(cells) != len(fields):
            raise InputError(
                f"expected {len(fields)} columns ({', '.join(fields)}), found {len(cells)}", path=path, line=number
            )
        rows.append(cells)
        lines.append(number)
    places = np.asarray(lines, np.int64)
    if not rows:
        return Columns(np.zeros((0, len(fields))), places)
    columns = list(zip(*rows, strict=True))
    numbers = [finite_numbers(cells, name, path, places) for cells, name in zip(columns, fields, strict=True)]
    return Columns(np.stack(numbers, -1), places)


INDEX = "\n"  # the heading of a column that numbers the rows: nothing that a file can call one

# --- CSV --------------------------------------------------------------------------------------------------------------


def read_csv(path: Path, *, words: Collection[str] = ()) -> Csv:
    """A CSV file with a header line. Blank lines and lines that begin with `#` are left out.

    The separator is the comma, semicolon or tab that the header uses. `words`: the columns, where they are there, that
    hold names; all others should hold numbers. A first column without a name, or called 'Unnamed: 0', is the index that
    pandas writes, and is passed over. InputError for a file without a header, a column named twice, or a row
    of another length than the header; what is wrong with a cell is said when its column is asked for.
    """
    return plain_csv(_read_bytes(path), path, words) or any_csv(path)


def plain_csv(content: bytes, path: Path, words: Collection[str]) -> Csv | None:
    """A header below comments, then a grid of numbers and words, nothing in quotes; None where it is not so plain."""
    if b"\r" in content and content.count(b"\r") == content.count(b"\r\n"):
        content = content.replace(b"\r\n", b"\n")
    if b"\r" in content or b'"' in content or not _is_text(content):
        return None
    above, below = _below_comments(content)
    first, _, body = below.partition(b"\n")
    line = first.decode()
    separator = _separator((above + first).decode())
    header = [name.strip() for name in line.split(separator)]
    if is_index(header[0]):
        header[0] = INDEX
    if b"#" in below or len(set(header)) < len(header) or not any(header):
        return None
    grid = separated(body, separator, len(header))
    if grid is None:
        return None
    named = [place for place, name in enumerate(header) if name in words]
    numbers, names = grid.numbers(*named), {header[place]: grid.words(place) for place in named}
    if numbers is None or None in names.values():
        return None
    columns = {name: names.get(name) or numbers[:, place] for place, name in enumerate(header) if name != INDEX}
    return Csv(path, columns, 2 + above.count(b"\n") + np.arange(len(numbers)))


def any_csv(path: Path) -> Csv:
    """As `read_csv`, cell by cell."""
    text = read_text(path)
    separator = _separator(text)
    header: list[str] | None = None
    rows, lines = [], []
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if header is None:
                header = [INDEX if is_index(cells[0]) else cells[0], *cells[1:]]
                continue
            if len(cells) != len(header):
                raise InputError(
                    f"expected {len(header)} columns ({', '.join(header)}), found {len(cells)}",
                    path=path,
                    line=reader.line_num,
                )
            rows.append(cells)
            lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}", path=path, line=reader.line_num) from None
    if header is None:
        raise InputError("empty; expected a header line with the names of the columns", path=path, line=1)
    for name in header:
        if header.count(name) > 1:
            raise InputError("this column stands twice in the header", path=path, line=1, field=name)
    columns = list(zip(*rows, strict=True)) if rows else [()] * len(header)
    named = {name: column for name, column in zip(header, columns, strict=True) if name != INDEX}
    return Csv(path, named, np.asarray(lines, np.int64))


def is_index(name: str) -> bool:
    """What the index of a table is called where pandas wrote it, or wrote it again."""
    return name in ("", "Unnamed: 0")


def _separator(text: str) -> str:
    """What the first line that is no comment has most of."""
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    return max(",;\t", key=first.count)


# --- plain files ------------------------------------------------------------------------------------------------------


def _is_text(content: bytes) -> bool:
    if b"\0" in content:
        return False
    try:
        return content.isascii() or bool(content.decode())
    except UnicodeDecodeError:
        return False


def _below_comments(content: bytes) -> tuple[bytes, bytes]:
    """Comments and empty lines at the top; and what follows, with one newline at its end."""
    start = 0
    while start < len(content):
        end = content.find(b"\n", start) + 1 or len(content)
        line = content[start:end].strip()
        if line and not line.startswith(b"#"):
            break
        start = end
    return content[:start], content[start:].rstrip(b"\r\n") + b"\n"
