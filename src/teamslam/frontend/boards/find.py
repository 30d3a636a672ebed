"""The corners of a board in images, by OpenCV: its detector of markers, its ChArUco interpolation, and its refinement
of crossings to a part of a pixel.

How a board was printed is found out from the first images in which anything is seen: ChArUco boards begin with a black
or a white square (OpenCV before 4.6), tags of grids have a black border of one cell or of two (Kalibr), and may be
printed upside down (OpenCV has them so).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.frontend.boards.board import FAMILIES, AprilGrid, Board, Charuco
from teamslam.geometry import AnyArray, Array, IntArray

FEWEST = 8  # corners that a view needs, not all of them in a line
UNDECIDED = 20  # images with corners after which the way of printing is settled


@dataclass(frozen=True, eq=False)
class Views:
    """Corners (m,) of a board in images of `size`: in which view, which of the board's corners, where [pixels]. Views
    count from 0; `frames` are the numbers of their images."""

    size: tuple[int, int]
    frames: IntArray
    view: IntArray
    corner: IntArray
    pixels: Array

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, views: AnyArray) -> "Views":
        """Some views, in this order."""
        chosen = np.arange(len(self))[views]
        place = np.full(len(self), -1)
        place[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(place[self.view] >= 0)
        rows = rows[np.argsort(place[self.view[rows]], kind="stable")]
        return Views(self.size, self.frames[chosen], place[self.view[rows]], self.corner[rows], self.pixels[rows])

    def without(self, wrong: AnyArray) -> "Views":
        """Some corners left out; the views stay."""
        return Views(self.size, self.frames, self.view[~wrong], self.corner[~wrong], self.pixels[~wrong])

    @classmethod
    def of(cls, size: tuple[int, int], frames: Sequence[int], found: Sequence[tuple[IntArray, Array]]) -> "Views":
        """From the corners of each image."""
        view = np.repeat(np.arange(len(found)), [len(ids) for ids, _ in found])
        return cls(
            size,
            np.array(frames, np.int64),
            view,
            np.concatenate([np.zeros(0, np.int64), *(ids for ids, _ in found)]),
            np.concatenate([np.zeros((0, 2)), *(at for _, at in found)]),
        )


class Finder:
    """Looks for one board in images. MissingExtraError without OpenCV, InputError for a dictionary that it has not."""

    def __init__(self, board: Board) -> None:
        self._board = board
        makers = _charuco if isinstance(board, Charuco) else _grid
        self._ways = makers(board)  # type: ignore[arg-type]
        self._found = np.zeros(len(self._ways), np.int64)
        self._images = 0

    def __call__(self, image: AnyArray) -> tuple[IntArray, Array] | None:
        """The corners seen in an image (h, w) of bytes: numbers and places [pixels]; None where they are too few, or
        all in a line."""
        image = np.ascontiguousarray(image)
        tried = self._ways if self._images < UNDECIDED else [self._ways[int(np.argmax(self._found))]]
        each = [way(image) for way in tried]
        counts = np.array([len(ids) for ids, _ in each])
        if len(each) > 1 and counts.any():
            self._found += counts
            self._images += 1
        ids, places = each[int(np.argmax(counts))]
        if len(ids) < FEWEST or np.linalg.matrix_rank(np.diff(self._board.points[ids, :2], axis=0), tol=1e-9) < 2:
            return None
        return ids, places


def _charuco(board: Charuco) -> list[Any]:
    cv2 = _opencv()
    book = _dictionary(cv2, board.dictionary)

    def way(legacy: bool) -> Any:
        made = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, book)
        made.setLegacyPattern(legacy)
        detector = cv2.aruco.CharucoDetector(made)

        def look(image: AnyArray) -> tuple[IntArray, Array]:
            corners, ids, _, _ = detector.detectBoard(image)
            if ids is None:
                return np.zeros(0, np.int64), np.zeros((0, 2))
            return ids.ravel().astype(np.int64), corners.reshape(-1, 2).astype(float)

        return look

    return [way(False), way(True)]


def _grid(board: AprilGrid) -> list[Any]:
    cv2 = _opencv()
    book = _dictionary(cv2, FAMILIES[board.family])
    count = board.columns * board.rows

    def way(border: int) -> Any:
        how = cv2.aruco.DetectorParameters()
        how.markerBorderBits = border
        detector = cv2.aruco.ArucoDetector(book, how)

        def look(image: AnyArray) -> tuple[IntArray, Array]:
            corners, ids, _ = detector.detectMarkers(image)
            numbers = np.zeros(0, np.int64) if ids is None else ids.ravel().astype(np.int64) - board.first
            kept = (numbers >= 0) & (numbers < count)
            if not kept.any():
                return np.zeros(0, np.int64), np.zeros((0, 2))
            squares = np.array(corners, np.float32).reshape(-1, 4, 2)[kept]
            numbers, first = np.unique(numbers[kept], return_index=True)
            return _upright(board, numbers, _refined(cv2, image, squares[first]))

        return look

    return [way(1), way(2)]


def _refined(cv2: Any, image: AnyArray, squares: AnyArray) -> Array:
    """Corners at the crossings of black squares, to a part of a pixel; within a fourth of the gap between tags, so that
    no other crossing is taken."""
    edge = float(np.median(np.linalg.norm(squares[:, 1] - squares[:, 0], axis=-1)))
    reach = int(np.clip(edge / 16.0, 2, 8))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    flat = np.ascontiguousarray(squares.reshape(-1, 1, 2))
    return np.asarray(cv2.cornerSubPix(image, flat, (reach, reach), (-1, -1), stop).reshape(-1, 4, 2), float)


def _upright(board: AprilGrid, numbers: IntArray, squares: Array) -> tuple[IntArray, Array]:
    """The corners of the tags by their numbers on the board: counter-clockwise from the bottom left, where OpenCV has
    them clockwise from a corner that depends on how the tag was printed. The board's own lines tell which."""
    points = board.points.reshape(-1, 4, 3)[numbers]
    turned = squares[:, ::-1]
    if len(numbers) < 2:
        return np.zeros(0, np.int64), np.zeros((0, 2))
    tries = [np.roll(turned, k, 1) for k in range(4)]
    costs = [_misfit(points[..., :2].reshape(-1, 2), tried.reshape(-1, 2)) for tried in tries]
    ids = (4 * numbers[:, None] + np.arange(4)).ravel()
    return ids, tries[int(np.argmin(costs))].reshape(-1, 2)


def _misfit(flat: Array, pixels: Array) -> float:
    """What the best affine map leaves [pixels]: enough to tell turned tags from upright ones."""
    base = np.concatenate([flat, np.ones((len(flat), 1))], -1)
    left = pixels - base @ np.linalg.lstsq(base, pixels, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def _dictionary(cv2: Any, name: str) -> Any:
    known = {n.removeprefix("DICT_").upper(): n for n in dir(cv2.aruco) if n.startswith("DICT_")}
    called = known.get(name.upper().removeprefix("DICT_"))
    if called is None:
        raise InputError(
            f"unknown dictionary '{name}'; OpenCV has {', '.join(sorted(known))}", field="board.dictionary"
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, called))


def _opencv() -> Any:
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("boards are found by OpenCV; install it with `pip install teamslam[tags]`") from None
    return cv2
