"""Boards whose corners are known: ChArUco (a chessboard with markers in its white squares) and AprilGrid (a grid of
tags with small black squares between their corners, as Kalibr prints it).

A board's frame: x to the right of who looks at it, y up, z towards him; its origin is the first corner.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array

FAMILIES = {"tag36h11": "APRILTAG_36h11", "tag36h10": "APRILTAG_36h10", "tag25h9": "APRILTAG_25h9",
            "tag16h5": "APRILTAG_16h5"}  # fmt: skip


@dataclass(frozen=True)
class Charuco:
    """`columns` x `rows` squares of edge `square_m` with markers of edge `marker_m` [m] of an OpenCV dictionary
    ('4X4_50', 'DICT_5X5_1000', ...). InputError for what can be no such board."""

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        _countable(self.columns, self.rows, least=3)
        if not 0.0 < self.marker_m < self.square_m < np.inf:
            raise InputError(
                f"a marker is smaller than its square, and both are above 0 [m]; found {self.marker_m:g} in "
                f"{self.square_m:g}",
                field="marker_m",
            )

    @property
    def points(self) -> Array:
        """Inner corners of the chessboard (n, 3) by their numbers in OpenCV: from the top left, line by line."""
        y, x = np.mgrid[0 : self.rows - 1, 0 : self.columns - 1].reshape(2, -1)
        return self.square_m * np.stack([x, -y, np.zeros(len(x))], -1).astype(float)

    def __str__(self) -> str:
        return f"ChArUco of {self.columns} x {self.rows} squares of {1e3 * self.square_m:g} mm ({self.dictionary})"


@dataclass(frozen=True)
class AprilGrid:
    """`columns` x `rows` tags of edge `tag_m` [m], numbered from `first` at the bottom left, line by line; the gap
    between two tags is `spacing` times their edge (Kalibr's tagSpacing). InputError for what can be no such board."""

    columns: int
    rows: int
    tag_m: float
    spacing: float = 0.3
    family: str = "tag36h11"
    first: int = 0

    def __post_init__(self) -> None:
        _countable(self.columns, self.rows, least=1)
        if not (0.0 < self.tag_m < np.inf and 0.0 < self.spacing < np.inf):
            raise InputError("a tag's edge [m] and its spacing are above 0", field="tag_m")
        if self.family not in FAMILIES:
            raise InputError(f"unknown family '{self.family}'; choose of {', '.join(FAMILIES)}", field="family")

    @property
    def points(self) -> Array:
        """Corners of the tags (n, 3): four a tag, from the bottom left counter-clockwise."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns].reshape(2, -1)
        lower = (1.0 + self.spacing) * np.stack([column, row, np.zeros(len(row))], -1)
        square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
        return np.asarray(self.tag_m * (lower[:, None] + square).reshape(-1, 3))

    def __str__(self) -> str:
        return f"AprilGrid of {self.columns} x {self.rows} tags of {1e3 * self.tag_m:g} mm ({self.family})"


Board = Charuco | AprilGrid


def _countable(columns: int, rows: int, least: int) -> None:
    if min(columns, rows) < least or columns * rows > 10_000:
        raise InputError(f"a board has at least {least} columns and rows, found {columns} x {rows}", field="columns")
