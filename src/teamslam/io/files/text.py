"""Numbers as text that reads back to the same bits, and text files written whole."""

from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.files.whole import whole_file
from teamslam.model import Kind, unpack


def text_of(number: float) -> str:
    """A number in the fewest digits that read back to the same bits."""
    return repr(float(number))


def rows_of_text(numbers: Array, separator: str = " ") -> list[str]:
    """Rows (n, k) of numbers, each as one string, in the fewest digits that read back to the same bits."""
    if not numbers.size:
        return [""] * len(numbers)
    if not np.isfinite(numbers).all():  # JSON has no words for these
        return [separator.join(map(repr, row)) for row in numbers.tolist()]
    text = msgspec.json.encode(numbers.tolist()).decode()
    return text[2:-2].replace(",", separator).split(f"]{separator}[")


def state_columns(rows: Array, kind: Kind) -> Array:
    """Rows (n, size) of the state vector as people write them: x y theta, x y z qx qy qz qw, x y or x y z."""
    data = unpack(rows, kind)
    if not isinstance(data, Pose):
        return data
    if kind.dim == 2:
        return data.xytheta()
    return quaternion_columns(data)


def quaternion_columns(poses: Pose) -> Array:
    """Poses (n,) in space as x y z qx qy qz qw: (n, 7)."""
    return np.concatenate([poses.translation, poses.quaternion_wxyz()[..., [1, 2, 3, 0]]], -1)


def write_text(path: Path, text: str | Iterable[str]) -> None:
    """Writes a text file whole or not at all, its folder made where absent. InputError where that is not possible."""
    parts = [text] if isinstance(text, str) else text
    try:
        with whole_file(path) as file:
            for part in parts:
                file.write(part.encode("utf-8"))
    except OSError as error:
        raise InputError(f"the file cannot be written: {error.strerror or error}", path=path) from None
