"""A CSV file with a header, read: columns by name, each cell with its place."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io.files.grid import Words, decoded
from teamslam.io.files.no_number import no_number

LIKE = 0.75  # of a misspelt name's letters, about, are those of the right one
NOISE = ("sigma", "cov_", "inf_")  # what columns of noise begin with


@dataclass(frozen=True, eq=False)
class Csv:
    """A CSV file: its columns by name, in their order, and the line each row stands on.

    A column is there as numbers, as words, or (where the file was not plain) as cells that may be either.
    """

    path: Path
    columns: Mapping[str, Array | Words | Sequence[str]]
    lines: IntArray

    def __len__(self) -> int:
        return len(self.lines)

    def has(self, *names: str) -> bool:
        """True where all these columns are there."""
        return all(name in self.columns for name in names)

    def words(self, name: str) -> Words:
        """A column of names, none of them empty. InputError where it or a cell of it is missing."""
        column = self._column(name)
        if isinstance(column, Words):
            return column
        assert not isinstance(column, np.ndarray), f"'{name}' is a column of words; tell read_csv so"
        if "" in column:
            raise self.fail(list(column).index(""), "empty; every row needs it", name)
        return Words.of(column)

    def given(self, name: str) -> BoolArray:
        """Where a column of names is not empty (n,)."""
        column = self._column(name)
        if isinstance(column, Words | np.ndarray):
            return np.ones(len(self), bool)
        return np.array([cell != "" for cell in column], bool)

    def given_words(self, name: str) -> Words:
        """The names in a column where it is not empty, in order."""
        column = self._column(name)
        return column if isinstance(column, Words) else Words.of([cell for cell in column if cell != ""])

    def numbers(self, *names: str) -> Array:
        """Columns as finite numbers (n, len(names)). InputError where one is missing, no number, or not finite."""
        columns = [self._column(name) for name in names]
        return np.stack([self._numbers(column, name) for column, name in zip(columns, names, strict=True)], -1)

    def fail(self, row: int, problem: str, name: str | None = None) -> InputError:
        """The error to raise about a row (0-based) and, if given, a column."""
        return InputError(problem, path=self.path, line=int(self.lines[row]), field=name)

    def refuse_others(self, known: Iterable[str]) -> None:
        """InputError for the first column that has no meaning here, with the nearest name that has."""
        known = sorted(known)
        for name in self.columns:
            if name not in known:
                near = difflib.get_close_matches(name, known, 1)
                hint = f"did you mean '{near[0]}'?" if near else f"known columns: {', '.join(known)}"
                raise InputError(f"unknown column; {hint}", path=self.path, line=1, field=name)

    def notes_of_others(self, known: Iterable[str]) -> list[str]:
        """Words on the columns that have no meaning here. InputError for one that looks like a known column, misspelt:
        like one that is not there, or like the end of one, or like one of noise."""
        known = sorted(known)
        others = [name for name in self.columns if name not in known]
        absent = {name.lower(): name for name in known if name not in self.columns}
        for name in others:
            near = difflib.get_close_matches(name.lower(), list(absent), 1, LIKE)
            near = near or [key for key in absent if key.endswith(f"_{name.lower()}")]
            if near or name.lower().startswith(NOISE):
                hint = f"did you mean '{absent[near[0]]}'?" if near else f"known columns: {', '.join(known)}"
                raise InputError(
                    f"unknown column; {hint} (a column of something else needs another name)",
                    path=self.path, line=1, field=name,
                )  # fmt: skip
        if not others:
            return []
        names = ", ".join(f"'{name}'" for name in others)
        many = f"columns {names} have" if len(others) > 1 else f"column {names} has"
        return [f"{self.path}: the {many} no meaning here and {'are' if len(others) > 1 else 'is'} not read"]

    def _column(self, name: str) -> Array | Words | Sequence[str]:
        if name not in self.columns:
            cure = (
                f"; found {', '.join(self.columns)}: rename one of these, or add it" if self.columns else "; found none"
            )
            raise InputError(f"no such column{cure}", path=self.path, line=1, field=name)
        return self.columns[name]

    def _numbers(self, column: Array | Words | Sequence[str], name: str) -> Array:
        if isinstance(column, np.ndarray):
            return column
        cells = [column[row] for row in range(len(self))] if isinstance(column, Words) else column
        return finite_numbers(cells, name, self.path, self.lines)


def finite_numbers(cells: Sequence[str], name: str, path: Path, lines: IntArray) -> Array:
    """Cells as finite numbers (n,), without negative zeros. InputError for the first that is none, with its line."""
    plain = decoded(cells)
    if plain is not None:
        return plain
    try:
        numbers = np.array(cells, float) + 0.0
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
        raise InputError(no_number(cell), path=path, line=line, field=name) from None
