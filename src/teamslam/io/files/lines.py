"""Text files of records, one a line: words read with errors that name the file, the line and the field.

What the readers of graph files share: words that are no numbers, numbers that are not finite, lines that are too short
or too long, triangles of symmetric matrices.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.files.delimited import read_text
from teamslam.model import Kind, unpack

LONGEST_WORD = 60  # shown in a message
LARGEST = 1e100  # no measurement is larger, and its square is still a number


@dataclass(frozen=True)
class Line:
    """One record: where it stands, its tag (first word) and the words after it."""

    path: Path
    number: int
    tag: str
    words: tuple[str, ...]

    def error(self, problem: str, field: str | None = None) -> InputError:
        """An InputError at this line."""
        return InputError(problem, path=self.path, line=self.number, field=field)

    def check_length(self, *lengths: int, form: str) -> None:
        """InputError where the words after the tag are not one of so many; `form` shows a good line."""
        if len(self.words) not in lengths:
            wanted = " or ".join(str(n) for n in lengths)
            raise self.error(f"{self.tag} needs {wanted} words after the tag, found {len(self.words)}; write '{form}'")

    def floats(self, start: int, names: Sequence[str]) -> list[float]:
        """The words from `start` on as finite numbers, one for each name."""
        try:
            found = [float(word) for word in self.words[start : start + len(names)]]
        except ValueError:
            found = []
        if len(found) == len(names) and all(abs(value) < LARGEST for value in found):
            return found
        return [self.float(start + k, name) for k, name in enumerate(names)]

    def float(self, at: int, name: str) -> float:
        """One word as a finite number."""
        word = self.words[at]
        try:
            value = float(word)
        except ValueError:
            raise self.error(f"expected a number, found '{word[:LONGEST_WORD]}'", name) from None
        if not abs(value) < LARGEST:
            raise self.error(f"expected a finite number, found '{word}'; remove the row or mend the value", name)
        return value

    def integer(self, at: int, name: str) -> int:
        """One word as a whole number."""
        word = self.words[at]
        try:
            return int(word)
        except ValueError:
            raise self.error(f"expected a whole number, found '{word[:LONGEST_WORD]}'", name) from None

    def symmetric(self, start: int, size: int, name: str) -> Array:
        """An upper triangle, row by row, as a full symmetric matrix (size, size)."""
        matrix = np.zeros((size, size))
        matrix[np.triu_indices(size)] = self.floats(start, [f"a number of {name}"] * triangle(size))
        return matrix + np.triu(matrix, 1).T


def read_pose(line: Line, start: int, dim: int) -> Pose:
    """A pose in a line: x y theta, or x y z qx qy qz qw with a quaternion of length about 1."""
    if dim == 2:
        return Pose.from_xytheta(np.array(line.floats(start, ("x", "y", "theta"))))
    numbers = np.array(line.floats(start, ("x", "y", "z", "qx", "qy", "qz", "qw")))
    length = float(np.linalg.norm(numbers[3:]))
    if not 0.9 < length < 1.1:
        raise line.error(f"a quaternion has length 1, found {length:.3g} (qx qy qz qw)")
    return Pose.from_quaternion(numbers[:3], numbers[[6, 3, 4, 5]])


def state_words(row: Array, kind: Kind) -> str:
    """A row of the state vector as a line has it: x y, x y z, or what `read_pose` reads."""
    if not kind.is_pose:
        return " ".join(map(text_of, row))
    pose = unpack(row, kind)
    assert isinstance(pose, Pose)
    if kind.dim == 2:
        return " ".join(map(text_of, pose.xytheta()))
    w, x, y, z = pose.quaternion_wxyz()
    return " ".join(map(text_of, (*pose.translation, x, y, z, w)))


def triangle(size: int) -> int:
    """Numbers in the upper triangle of a matrix (size, size)."""
    return size * (size + 1) // 2


def read_lines(path: Path) -> Iterator[Line]:
    """The records of a text file; empty lines and lines that start with '#' are passed over."""
    text = read_text(path)
    if not text.strip():
        raise InputError("the file is empty", path=path)
    for number, row in enumerate(text.split("\n"), 1):
        words = row.split()
        if words and not words[0].startswith("#"):
            yield Line(path, number, words[0], tuple(words[1:]))


def text_of(number: float) -> str:
    """A number in the fewest digits that read back to the same bits."""
    return repr(float(number))


def write_text(path: Path, text: str) -> None:
    """Writes a file, its folder made where absent. InputError where that is not possible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(f"the file cannot be written: {error}", path=path) from None
