"""Text that is a plain grid of cells, read all at once.

Where cells end is found in a few passes over the bytes. The numbers are parsed by msgspec, whose JSON decoder rounds
correctly and takes a tenth of the time of float(): with a comma after each cell and brackets around all of them a grid
is a JSON array. A cell that is no JSON number (a word, nothing, "nan", "+1", ".5") makes the whole grid None, and its
reader goes through it cell by cell, to find out what it is and on which line.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
import numpy.typing as npt

from teamslam.geometry import Array, IntArray
from teamslam.model import rows_of

Bytes = npt.NDArray[np.uint8]

_NUMBERS = msgspec.json.Decoder(list[float])
_BLANK, _COMMA, _NEWLINE, _ZERO = b" ,\n0"
_NO_BLANKS = bytes([*range(0x09), *range(0x0E, 0x1C)])  # below a blank, and yet no white space
LONGEST_WORD = 64
LONGEST_CELL = 1000


@dataclass(frozen=True, eq=False)
class Words:
    """A column of words: of each row (m,) the place of its word among `names`, which stand in order of appearance."""

    names: tuple[str, ...]
    codes: IntArray

    @classmethod
    def of(cls, words: Sequence[str]) -> "Words":
        """From the words themselves."""
        place = {name: k for k, name in enumerate(dict.fromkeys(words))}
        return cls(tuple(place), np.array([place[word] for word in words], np.int64))

    def __len__(self) -> int:
        return len(self.codes)

    def __getitem__(self, row: int) -> str:
        return self.names[int(self.codes[row])]


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells in rows and columns: `text`, and where in it each cell ends (m, n), one before the next begins."""

    text: Bytes
    ends: IntArray

    def numbers(self, *without: int) -> Array | None:
        """All cells as finite numbers (m, n), those of the columns `without` as 0; None where one is no number.

        There is no negative zero.
        """
        starts = self._starts
        if (self.ends - starts).max(initial=0) > LONGEST_CELL:
            return None
        text = np.empty(len(self.text) + 1, np.uint8)
        text[0], text[1:] = ord("["), self.text
        for column in without:
            start, end = starts[:, column], self.ends[:, column]
            if (start == end).any():
                return None
            text[1 + rows_of(start, end - start)] = _BLANK
            text[end] = _ZERO  # the cell's last character
        text[1 + self.ends] = _COMMA
        text[1 + self.ends[-1, -1]] = ord("]")
        try:
            found = _NUMBERS.decode(text[: 2 + self.ends[-1, -1]].data)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return None
        if len(found) != self.ends.size:
            return None
        numbers = np.fromiter(found, float, len(found)).reshape(self.ends.shape) + 0.0
        return numbers if np.isfinite(numbers).all() else None

    def words(self, column: int) -> Words | None:
        """A column as words without blanks around them; None where one is empty or long."""
        start = self._starts[:, column]
        length = self.ends[:, column] - start
        width = int(length.max(initial=0))
        if not 0 < width <= LONGEST_WORD:
            return None
        places = start[:, None] + np.arange(width)
        letters = self.text[np.minimum(places, len(self.text) - 1)]
        letters[places >= self.ends[:, column, None]] = 0
        found, first, codes = np.unique(letters.view(f"S{width}"), return_index=True, return_inverse=True)
        order = np.argsort(first)
        names = Words.of([name.decode().strip() for name in found[order].tolist()])
        if "" in names.names:
            return None
        return Words(names.names, names.codes[np.argsort(order)][codes.ravel()])

    @property
    def _starts(self) -> IntArray:
        starts = np.empty(self.ends.size, np.int64)
        starts[0], starts[1:] = 0, self.ends.ravel()[:-1] + 1
        return starts.reshape(self.ends.shape)


def separated(text: bytes, separator: str, columns: int) -> Grid | None:
    """The grid of lines, each ending in a newline, of so many cells with a separator between; None where it is none."""
    letters = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero((letters == ord(separator)) | (letters == _NEWLINE))
    if not len(ends) or len(ends) % columns or ends[-1] != len(letters) - 1:
        return None
    grid = Grid(letters, ends.reshape(-1, columns))
    newlines = letters[grid.ends] == _NEWLINE
    return grid if newlines[:, -1].all() and not newlines[:, :-1].any() else None


def between_blanks(text: bytes, columns: int) -> tuple[Grid, IntArray] | None:
    """The grid of lines, each ending in a newline, empty or of so many cells with blanks between; and the line, counted
    from 0, of each row (m,). None where it is none."""
    letters = np.frombuffer(text, np.uint8)
    blank = letters <= _BLANK
    if len(text.translate(None, _NO_BLANKS)) < len(text):
        return None
    ends = np.flatnonzero(~blank[:-1] & blank[1:]) + 1
    if not len(ends) or len(ends) % columns or letters[-1] != _NEWLINE:
        return None
    grid = Grid(letters, ends.reshape(-1, columns))
    newlines = np.flatnonzero(letters == _NEWLINE)
    first, last = (np.searchsorted(newlines, grid.ends[:, column]) for column in (0, -1))
    return None if (first != last).any() or (np.diff(first) <= 0).any() else (grid, np.asarray(first))


def decoded(words: Sequence[str]) -> Array | None:
    """Words as finite numbers (m,), without negative zeros; None where one is no JSON number."""
    try:
        found = _NUMBERS.decode(f"[{','.join(words)}]")
    except (msgspec.DecodeError, UnicodeEncodeError):
        return None
    numbers = np.array(found, float) + 0.0
    return numbers if len(found) == len(words) and np.isfinite(numbers).all() else None
