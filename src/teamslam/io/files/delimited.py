"""Columns of numbers and words from text files, every cell with its place: errors name file, line and field.

Two shapes of file: columns between blanks with `#` comments (`read_columns`), and CSV with a header as spreadsheets and
pandas write it (`read_csv`: comma, semicolon or tab, quotes, a byte-order mark).
"""

import csv
import difflib
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray


def read_text(path: Path) -> str:
    """The whole of a text file (UTF-8, with or without a byte-order mark). InputError where it is absent or no text."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError("no such file", path=path) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", path=path) from None
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is no text; expected a text file (UTF-8)", path=path) from None
    if "\0" in text:
        raise InputError("holds bytes of value 0; expected a text file (UTF-8)", path=path)
    return text


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
    numbers = [_numbers(cells, name, path, places) for cells, name in zip(columns, fields, strict=True)]
    return Columns(np.stack(numbers, -1), places)


@dataclass(frozen=True, eq=False)
class Csv:
    """A CSV file with a header: cells by column name, and the line each row stands on."""

    path: Path
    cells: dict[str, tuple[str, ...]]
    lines: IntArray

    def __len__(self) -> int:
        return len(self.lines)

    def has(self, *names: str) -> bool:
        """True where all these columns are there."""
        return all(name in self.cells for name in names)

    def words(self, name: str) -> tuple[str, ...]:
        """A column as words, none of them empty. InputError where the column or a cell is missing."""
        self._require(name)
        for cell, line in zip(self.cells[name], self.lines.tolist(), strict=True):
            if not cell:
                raise InputError("empty; every row needs it", path=self.path, line=line, field=name)
        return self.cells[name]

    def numbers(self, *names: str) -> Array:
        """Columns as finite numbers (n, len(names)). InputError where one is missing, no number, or not finite."""
        for name in names:
            self._require(name)
        return np.stack([_numbers(self.cells[name], name, self.path, self.lines) for name in names], -1)

    def fail(self, row: int, problem: str, name: str | None = None) -> InputError:
        """The error to raise about a row (0-based) and, if given, a column."""
        return InputError(problem, path=self.path, line=int(self.lines[row]), field=name)

    def refuse_others(self, known: Iterable[str]) -> None:
        """InputError for the first column that has no meaning here, with the nearest name that has."""
        known = sorted(known)
        for name in self.cells:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1)
                hint = f"did you mean '{near[0]}'?" if near else f"known columns: {', '.join(known)}"
                raise InputError(f"unknown column; {hint}", path=self.path, line=1, field=name)

    def _require(self, name: str) -> None:
        if name not in self.cells:
            raise InputError(
                f"no such column; found {', '.join(self.cells) or 'none'}", path=self.path, line=1, field=name
            )


def read_csv(path: Path) -> Csv:
    """A CSV file with a header line. Blank lines and lines that begin with `#` are left out.

    The separator is the comma, semicolon or tab that the header uses. InputError for a file without a header, a column
    named twice, or a row of another length than the header.
    """
    text = read_text(path)
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    separator = max(",;\t", key=first.count)
    header: list[str] | None = None
    rows, lines = [], []
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if header is None:
                header = cells
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
    return Csv(path, dict(zip(header, columns, strict=True)), np.asarray(lines, np.int64))


def _numbers(cells: Sequence[str], name: str, path: Path, lines: IntArray) -> Array:
    try:
        numbers = np.array(cells, float)
    except (ValueError, OverflowError):
        numbers = np.array([_number(c, name, path, n) for c, n in zip(cells, lines.tolist(), strict=True)], float)
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        raise InputError(
            f"'{cells[bad[0]]}' is not a finite number; leave the row out if the value is not known",
            path=path,
            line=int(lines[bad[0]]),
            field=name,
        )
    return numbers


def _number(cell: str, name: str, path: Path, line: int) -> float:
    try:
        return float(cell)
    except ValueError:
        comma = " (decimal commas are not read: write a point)" if cell.count(",") == 1 else ""
        shown = cell if len(cell) <= 40 else cell[:37] + "..."
        raise InputError(f"expected a number, found '{shown}'{comma}", path=path, line=line, field=name) from None
