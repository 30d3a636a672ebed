"""Columns of JSON values: what `Json` does with one value, done with many of the same role at once.

Values are looked at one by one only to find the first that is not as expected; the error is that of `Json`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io.files.json_place import Json
from teamslam.io.files.records import LARGEST


@dataclass(frozen=True, eq=False)
class JsonColumn:
    """Values (n,) and where each stands."""

    path: Path
    values: Sequence[Any]
    where: Callable[[int], str]

    @classmethod
    def of(cls, path: Path, places: Sequence[Json]) -> "JsonColumn":
        """Some places of one file."""
        return cls(path, [place.value for place in places], lambda row: places[row].where)

    def __len__(self) -> int:
        return len(self.values)

    def place(self, row: int) -> Json:
        """One value and where it stands."""
        return Json(self.path, self.where(row), self.values[row])

    def select(self, rows: BoolArray | IntArray) -> "JsonColumn":
        """The rows at a mask or index."""
        places = np.arange(len(self))[rows].tolist()
        return JsonColumn(self.path, [self.values[row] for row in places], lambda row: self.where(places[row]))

    def are(self, kind: type) -> BoolArray:
        """Which values are of a type (n,)."""
        return np.fromiter((isinstance(value, kind) for value in self.values), bool, len(self))

    def have(self, name: str) -> BoolArray:
        """Which values are objects with such an entry (n,)."""
        return np.fromiter((isinstance(value, dict) and name in value for value in self.values), bool, len(self))

    def get(self, name: str) -> "JsonColumn":
        """An entry of objects. InputError where it is missing."""
        try:
            found = [value[name] for value in self.values]
        except (KeyError, TypeError):
            found = [self.place(row).get(name).value for row in range(len(self))]
        return JsonColumn(self.path, found, lambda row: f"{self.where(row)}.{name}")

    def elements(self) -> tuple["JsonColumn", IntArray, IntArray]:
        """The elements of all lists, the list that each is of, and its number in there."""
        self._check({list}, Json.elements)
        lengths = np.fromiter(map(len, self.values), np.int64, len(self))
        lists = np.repeat(np.arange(len(self)), lengths)
        numbers = np.arange(len(lists)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        column = JsonColumn(
            self.path,
            list(chain.from_iterable(self.values)),
            lambda row: f"{self.where(int(lists[row]))}[{numbers[row]}]",
        )
        return column, lists, numbers

    def texts(self) -> Sequence[str]:
        """Texts."""
        self._check({str}, Json.text)
        return self.values

    def wholes(self) -> Sequence[int]:
        """Whole numbers."""
        self._check({int}, Json.whole)
        return self.values

    def numbers(self) -> Array:
        """Finite numbers (n,)."""
        self._check({int, float}, Json.number)
        try:
            found = np.array(self.values, float)
        except OverflowError:
            found = np.array([np.inf])
        if not (np.abs(found) < LARGEST).all():
            found = np.array([self.place(row).number() for row in range(len(self))])
        return found

    def rows(self, count: int, form: str | None = None) -> Array:
        """Lists of so many finite numbers (n, count); `form` says in an error what they are."""
        elements, _, _ = self.elements()
        numbers = elements.numbers()
        for row, value in enumerate(self.values):
            if len(value) != count:
                expected = f"{count} numbers{f' ({form})' if form else ''}"
                raise self.place(row).error(f"expected {expected}, found {len(value)}")
        return numbers.reshape(len(self), count)

    def refuse(self, bad: BoolArray, problem: Callable[[int], str]) -> None:
        """InputError at the first row where `bad` (n,) holds."""
        if bad.any():
            row = int(np.argmax(bad))
            raise self.place(row).error(problem(row))

    def _check(self, types: set[type], read: Callable[[Json], object]) -> None:
        """InputError of `read` at the first value that is not of one of these types."""
        if not set(map(type, self.values)) <= types:
            for row in range(len(self)):
                read(self.place(row))
