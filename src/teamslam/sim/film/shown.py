"""Calibration boards shown to a camera: printed, carried by hand before it, and filmed.

    tour         as one should: near and far, leaned up to 40 degrees to all sides, into the corners of the image
    one angle    as one should not: leaned 7 to 9 degrees one way, always as far away

Needs OpenCV for the pictures of markers (extra `tags`).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.boards.board import FAMILIES, AprilGrid, Board, Charuco
from teamslam.geometry import AnyArray, Array, Pose
from teamslam.sim.film.boards import BLACK, WHITE, opencv
from teamslam.sim.film.boards import Board as Rectangle
from teamslam.sim.film.develop import develop
from teamslam.sim.film.render import Renderer
from teamslam.sim.film.stage import Stage
from teamslam.sim.film.takes import Options

TOURS = ("tour", "one-angle")
EYE = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 1.2]))
RATES_HZ = (0.031, 0.047, 0.019, 0.061, 0.053, 0.037, 0.013, 0.071)  # of its distance, leans, places; as hands are


@dataclass(frozen=True, eq=False)
class Shown:
    """A board that is shown to the camera of `options`, `stretch` longer one way than stated (as printers have it).
    The same seed gives the same images, to the bit."""

    board: Board
    options: Options
    tour: str = "tour"
    stretch: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.tour not in TOURS:
            raise InputError(f"a board is shown as {' or '.join(TOURS)}, found '{self.tour}'", field="tour")

    @property
    def stamps_s(self) -> Array:
        """When each image is taken [s]."""
        return np.asarray(np.arange(0.0, self.options.seconds, 1.0 / self.options.images_hz))

    def images(self) -> Iterator[AnyArray]:
        """Each image (h, w) of bytes."""
        o = self.options
        draw = Renderer(Stage({}, (), (), ()), o.camera, o.shutter)
        printed = self._printed()
        for k, t in enumerate(self.stamps_s.tolist()):
            times = o.shutter.times(t, o.camera.size[1])
            place = Pose(np.broadcast_to(EYE.rotation, (*times.shape, 3, 3)),
                         np.broadcast_to(EYE.translation, (*times.shape, 3)))  # fmt: skip
            light = draw.scene(place, [(printed, place @ self.poses(times))])
            yield develop(light, o.sensor, t, np.random.default_rng([self.seed, 3, k]))

    def poses(self, t_s: Array) -> Pose:
        """Where the board's middle is in the camera, x right of who looks at it, y up, z towards him."""
        rng = np.random.default_rng([self.seed, 4])
        phase = rng.uniform(0.0, 2.0 * np.pi, 8)
        s = [np.sin(2.0 * np.pi * np.asarray(t_s, float) * hz + p) for hz, p in zip(RATES_HZ, phase, strict=True)]
        middle = np.abs(self.board.points).max(0)
        size = float(np.hypot(*middle[:2]))
        f = self.options.camera.focal[0] / self.options.camera.size[0]
        if self.tour == "tour":
            distance = f * size * (1.7 + 0.7 * s[0])
            lean, aside, turn = np.radians(40.0) * s[1], np.radians(40.0) * s[3], np.radians(25.0) * s[4]
            reach = 0.33
        else:
            distance = f * size * np.full(np.shape(t_s), 1.25)
            lean, aside, turn = np.radians(8.0 + s[1]), np.zeros(np.shape(t_s)), np.radians(1.0) * s[4]
            reach = 0.08
        x, y = distance / f * reach * s[2], distance / f * reach * 0.75 * s[5]
        half = np.diag([1.0, -1.0, -1.0])  # upright before the camera, its face towards it
        rotation = half @ _about(0, lean) @ _about(1, aside) @ _about(2, turn)
        return Pose(rotation, np.stack([x, y, distance], -1))

    def _printed(self) -> Rectangle:
        picture, size = printed(self.board)
        return Rectangle(Pose.identity(3, ()), (size[0], size[1] * (1.0 + self.stretch)), picture)


def printed(board: Board) -> tuple[AnyArray, tuple[float, float]]:
    """The picture of a board with a white margin, and its size (width, height) [m]."""
    return _charuco(board) if isinstance(board, Charuco) else _grid(board)


def _charuco(board: Charuco) -> tuple[AnyArray, tuple[float, float]]:
    cv2 = opencv()
    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary.removeprefix('DICT_')}"))
    inner = book.markerSize + 2
    cell = board.marker_m / inner
    per = board.square_m / cell
    if abs(per - round(per)) > 1e-6 or round(per - inner) % 2:
        raise InputError(
            f"a marker of {inner} cells must leave whole cells around it in its square: take marker_m = "
            f"{inner / (inner + 2):.4g} of square_m",
            field="marker_m",
        )
    made = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, book)
    size = board.columns * round(per), board.rows * round(per)
    image = np.asarray(made.generateImage(size, marginSize=0, borderBits=1))
    margin = round(per) // 2
    picture = np.pad(image > 127, margin, constant_values=True)
    return np.where(picture, WHITE, BLACK), (picture.shape[1] * cell, picture.shape[0] * cell)


def _grid(board: AprilGrid) -> tuple[AnyArray, tuple[float, float]]:
    """As Kalibr prints it, with a border of two cells and squares that touch the corners of tags."""
    cv2 = opencv()
    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{FAMILIES[board.family]}"))
    cells = book.markerSize + 4
    gap = board.spacing * cells
    if abs(gap - round(gap)) > 1e-6:
        raise InputError(f"drawn by cells of a tag, spacing is a multiple of 1/{cells}", field="spacing")
    gap, pitch = round(gap), cells + round(gap)
    picture = np.ones((board.rows * pitch + gap, board.columns * pitch + gap), bool)
    for row in range(board.rows + 1):
        for column in range(board.columns + 1):
            top, left = (board.rows - row) * pitch, column * pitch
            picture[top : top + gap, left : left + gap] = False
            if row < board.rows and column < board.columns:
                number = board.first + row * board.columns + column
                tag = cv2.aruco.generateImageMarker(book, number, cells, borderBits=2)[::-1, ::-1] > 127
                picture[top - cells : top, left + gap : left + gap + cells] = tag
    picture = np.pad(picture, gap, constant_values=True)
    cell = board.tag_m / cells
    return np.where(picture, WHITE, BLACK), (picture.shape[1] * cell, picture.shape[0] * cell)


def _about(axis: int, angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    out = np.zeros((*np.shape(angle), 3, 3))
    i, j = [k for k in range(3) if k != axis]
    out[..., axis, axis] = 1.0
    out[..., i, i], out[..., j, j] = c, c
    out[..., i, j], out[..., j, i] = -s, s
    return out
