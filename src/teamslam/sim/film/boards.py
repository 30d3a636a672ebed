"""Boards: rectangles in space with a picture, of which everything in a film but the room itself is made.

A board's frame: x to the right of who looks at it, y up, z towards him; its centre is the origin. A picture is an array
of cells, row 0 on top, of how much light each gives back, 0 to 1.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.geometry import Array, Pose

BLACK, WHITE = 0.06, 0.85
PER_SIDE = 8  # cells of a tag's black square in the family tag36h11
FAMILY = "tag36h11"


@dataclass(frozen=True, eq=False)
class Board:
    """A rectangle of `size_m` (width, height) with a picture, at `pose` in its carrier (a room or a robot)."""

    pose: Pose
    size_m: tuple[float, float]
    picture: Array

    @property
    def corners(self) -> Array:
        """Its corners (4, 3) in the carrier."""
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * np.array(self.size_m)
        return np.asarray(self.pose.act(np.concatenate([half, np.zeros((4, 1))], -1)))


def tag_board(number: int, size_m: float, pose: Pose) -> Board:
    """A tag of the family tag36h11, its black square of `size_m`, with the white margin of one cell that it needs."""
    side = size_m * (PER_SIDE + 2) / PER_SIDE
    return Board(pose, (side, side), tag_picture(number))


def tag_picture(number: int) -> Array:
    """The cells (10, 10) of a tag with its margin, as its makers print it; OpenCV keeps them on their heads.
    InputError for a number that the family has not."""
    cv2 = opencv()
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    if not 0 <= number < len(book.bytesList):
        raise InputError(f"{FAMILY} has tags 0 to {len(book.bytesList) - 1}, found {number}", field="number")
    bits = cv2.aruco.generateImageMarker(book, number, PER_SIDE, borderBits=1)[::-1, ::-1] > 127
    return np.where(np.pad(bits, 1, constant_values=True), WHITE, BLACK)


def box(size_m: tuple[float, float, float], centre: Array, grey: float) -> list[Board]:
    """The four sides and the top of a plain box that stands upright."""
    length, width, height = size_m
    plain = np.full((1, 1), grey)
    sides = [
        Board(facing(angle, centre + 0.5 * np.array([along * np.cos(angle), along * np.sin(angle), 0.0])),
              (across, height), plain)
        for angle, along, across in ((0.0, length, width), (np.pi / 2, width, length),
                                     (np.pi, length, width), (-np.pi / 2, width, length))
    ]  # fmt: skip
    top = Pose(np.eye(3), centre + np.array([0.0, 0.0, 0.5 * height]))
    return [*sides, Board(top, (length, width), 1.2 * plain)]


def facing(angle: float, place: Array) -> Pose:
    """The pose of an upright board that looks in a direction over ground."""
    z = np.array([np.cos(angle), np.sin(angle), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return Pose(np.stack([np.cross(up, z), up, z], -1), np.asarray(place, float))


def opencv() -> Any:
    """OpenCV. MissingExtraError where it is not installed."""
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("filming needs OpenCV; install it with `pip install teamslam[tags]`") from None
    return cv2
