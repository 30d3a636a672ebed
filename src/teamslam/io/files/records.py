"""Text files of records, one a line: all lines with one tag as columns, with errors that name file, line and field.

What the readers of graph files share: words that are no numbers, numbers that are not finite, lines that are too short
or too long, triangles of symmetric matrices, poses. A file is read in one pass, and numbers a column at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose
from teamslam.io.files.delimited import read_text
from teamslam.io.files.garbage import uncollected
from teamslam.io.files.grid import decoded
from teamslam.io.files.no_number import no_number

LONGEST_WORD = 60  # shown in a message
LARGEST = 1e100  # no measurement is larger, and its square is still a number
NO_DATA = {  # what is downloaded in place of a file, by its beginning
    "version https://git-lfs": "this is a pointer to a large file, not the file: run 'git lfs pull' where it came from",
    "<!doctype html": "this is a page of the web; download the file itself ('raw')",
    "<html": "this is a page of the web; download the file itself ('raw')",
}
XYTHETA = ("x", "y", "theta")
QUATERNION = ("x", "y", "z", "qx", "qy", "qz", "qw")
EULER = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True, eq=False)
class Records:
    """Lines of one file with one tag (its first word): where each stands (n,), and the words after the tag."""

    path: Path
    tag: str
    lines: IntArray
    words: list[list[str]]

    def __len__(self) -> int:
        return len(self.words)

    def select(self, rows: AnyArray | BoolArray) -> "Records":
        """The lines at an index or mask."""
        picked = np.arange(len(self))[rows]
        return Records(self.path, self.tag, self.lines[picked], [self.words[row] for row in picked.tolist()])

    def by_length(self) -> "list[Records]":
        """The lines of each length by themselves, shortest first."""
        lengths = np.array([len(words) for words in self.words])
        return [self.select(lengths == length) for length in np.unique(lengths)]

    def error(self, row: int, problem: str, field: str | None = None) -> InputError:
        """An InputError at one line."""
        return InputError(problem, path=self.path, line=int(self.lines[row]), field=field)

    def check_length(self, *lengths: int, form: str) -> None:
        """InputError for the first line whose words after the tag are not one of so many; `form` shows a good line."""
        for row, words in enumerate(self.words):
            if len(words) not in lengths:
                wanted = " or ".join(str(n) for n in lengths)
                raise self.error(
                    row, f"{self.tag} needs {wanted} words after the tag, found {len(words)}; write '{form}'"
                )

    def column(self, at: int) -> list[str]:
        """One word of each line."""
        return [words[at] for words in self.words]

    def floats(self, start: int, names: Sequence[str]) -> Array:
        """The words from `start` on as finite numbers, a column for each name: (n, len(names))."""
        count = len(names)
        flat = [word for words in self.words for word in words[start : start + count]]
        found = decoded(flat) if len(flat) == len(self) * count else None
        if found is not None and (np.abs(found) < LARGEST).all():
            return found.reshape(len(self), count)
        return np.array([[self._float(row, start + k, n) for k, n in enumerate(names)] for row in range(len(self))])

    def integers(self, at: int, name: str) -> IntArray:
        """One word of each line as a whole number from 0 to 2^63 - 1."""
        try:
            found = np.array([int(words[at]) for words in self.words], np.int64)
            if (found >= 0).all():
                return found
        except (ValueError, OverflowError):
            pass
        return np.array([self._integer(row, at, name) for row in range(len(self))], np.int64)

    def symmetric(self, start: int, size: int, name: str) -> Array:
        """Upper triangles, row by row, as full symmetric matrices (n, size, size)."""
        matrices = np.zeros((len(self), size, size))
        above = np.triu_indices(size)
        matrices[:, above[0], above[1]] = self.floats(start, [f"a number of {name}"] * triangle(size))
        return matrices + np.swapaxes(np.triu(matrices, 1), 1, 2)

    def poses(self, start: int, dim: int) -> Pose:
        """Poses (n,): x y theta, or x y z qx qy qz qw with quaternions of length about 1."""
        if dim == 2:
            return Pose.from_xytheta(self.floats(start, XYTHETA))
        numbers = self.floats(start, QUATERNION)
        lengths = np.linalg.norm(numbers[:, 3:], axis=-1)
        wrong = np.flatnonzero(~((lengths > 0.9) & (lengths < 1.1)))
        if len(wrong):
            row = int(wrong[0])
            raise self.error(row, f"a quaternion has length 1, found {lengths[row]:.3g} (qx qy qz qw)")
        return Pose.from_quaternion(numbers[:, :3], numbers[:, [6, 3, 4, 5]])

    def refuse(self, wrong: BoolArray, problem: str, field: str | None = None) -> None:
        """InputError at the first of the lines where `wrong` (n,) is true; `{0}`, `{1}`, ... are its words."""
        rows = np.flatnonzero(wrong)
        if len(rows):
            row = int(rows[0])
            shown = [word[:LONGEST_WORD] for word in self.words[row]]
            raise self.error(row, problem.format(*shown), field)

    def _float(self, row: int, at: int, name: str) -> float:
        word = self.words[row][at]
        try:
            value = float(word)
        except ValueError:
            raise self.error(row, no_number(word), name) from None
        if not abs(value) < LARGEST:
            raise self.error(row, f"expected a finite number, found '{word}'; remove the row or mend the value", name)
        return value

    def _integer(self, row: int, at: int, name: str) -> int:
        word = self.words[row][at]
        try:
            value = int(word)
        except ValueError:
            raise self.error(row, f"expected a whole number, found '{word[:LONGEST_WORD]}'", name) from None
        if not 0 <= value < 1 << 63:
            raise self.error(row, f"expected a whole number from 0 to 2^63 - 1, found {word[:LONGEST_WORD]}", name)
        return value


def triangle(size: int) -> int:
    """Numbers in the upper triangle of a matrix (size, size)."""
    return size * (size + 1) // 2


def read_records(path: Path) -> list[Records]:
    """The records of a text file, those of each tag together in the order in which tags first appear.

    Empty lines, and from a '#' on the rest of a line, are passed over. InputError for a file that is absent or empty.
    """
    text = read_text(path)
    if not text.strip():
        raise InputError("the file is empty", path=path)
    beginning = text.lstrip()[:LONGEST_WORD].lower()
    for start, problem in NO_DATA.items():
        if beginning.startswith(start):
            raise InputError(problem, path=path)
    found: dict[str, tuple[list[int], list[list[str]]]] = {}
    with uncollected():
        for number, row in enumerate(text.split("\n"), 1):
            words = row.split("#", 1)[0].split() if "#" in row else row.split()
            if words:
                tag = words.pop(0)
                if tag not in found:
                    found[tag] = ([], [])
                lines, rest = found[tag]
                lines.append(number)
                rest.append(words)
    return [Records(path, tag, np.array(lines, np.int64), rest) for tag, (lines, rest) in found.items()]


def first_tag(path: Path) -> str | None:
    """The first word of a file's first record, None where there is none: what a file looks like, by its beginning."""
    try:
        with path.open("rb") as file:
            start = file.read(4096).decode("utf-8-sig", errors="ignore")
    except OSError:
        return None
    return next((row.split()[0] for row in start.split("\n") if row.strip() and not row.lstrip().startswith("#")), None)
