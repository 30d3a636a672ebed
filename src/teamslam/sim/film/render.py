"""What a camera sees: for each point of the image the first surface on its ray.

The rays go backwards through the lens, distortion and all, so nothing is approximated but by the number of points. The
room itself is drawn by one ray a pixel, as its pattern is soft; boards by 3 x 3, each at an instant of its own. Points
on one grid for the whole image would move an edge that runs along its lines to the nearest of them, by up to a sixth
of a pixel all along; so each line's points are shifted along it, and each column's likewise, by a step of STAGGER that
never comes back. Which instant a point has goes round in the same way, from pixel to pixel: over nine lines, or nine
columns, each place has had each.

    board's frame:   o + s d,   with o the eye and d the ray there;   it is met at s = -o_z / d_z
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline

from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose
from teamslam.sim.film.boards import Board
from teamslam.sim.film.shutter import FINE, MAGIC, Shutter
from teamslam.sim.film.stage import CAMERA, HEIGHT_M, SIDE_M, Stage

GRID = 8  # pixels between those whose rays are computed; a spline gives the others
STAGGER = 0.5 * (np.sqrt(5.0) - 1.0)  # of the distance between points: the golden section spreads most evenly


@dataclass(frozen=True, eq=False)
class Renderer:
    """Draws what the camera of one robot sees on a stage."""

    stage: Stage
    camera: Camera
    shutter: Shutter

    def image(self, robot: int, middle_s: float) -> Array:
        """The light (h, w) on each pixel, 0 to about 1, in an image whose middle line is exposed about `middle_s`."""
        eye = self._eye(robot, middle_s)
        image = self._room(eye[1, 1])[0]
        for board, carrier in self._before(robot, middle_s):
            self._draw(image, board, eye, carrier)
        return image

    def depth(self, robot: int, middle_s: float) -> Array:
        """How far along the camera's axis (h, w) [m] the first surface is, each line at the middle of its exposure."""
        eye = self._eye(robot, middle_s)
        depth = self._room(eye[1, 1])[1]
        for board, carrier in self._before(robot, middle_s):
            if (met := self._met(board, eye[1:2, 1:2], carrier[1:2, 1:2])) is not None:
                window, there, _, _, s = met
                part = depth[window]
                part[there[0, 0]] = s[0, 0][there[0, 0]]
        return depth

    def _eye(self, robot: int, middle_s: float) -> Pose:
        times = self.shutter.times(middle_s, self.camera.size[1])
        return _body(self.stage.ways[robot].at(times)) @ CAMERA

    def _before(self, robot: int, middle_s: float) -> Iterator[tuple[Board, Pose]]:
        """All boards that a robot may see, on carriers at poses (3, 3, lines), those behind first."""
        times = self.shutter.times(middle_s, self.camera.size[1])
        yield from ((board, Pose.identity(3, times.shape)) for board in self.stage.hanging)
        others = [k for k in range(len(self.stage.ways)) if k != robot]
        here = self.stage.ways[robot].at(np.array(middle_s))[:2]
        for other in sorted(
            others, key=lambda k: -np.linalg.norm(self.stage.ways[k].at(np.array(middle_s))[:2] - here)
        ):
            body = _body(self.stage.ways[other].at(times))
            middle = body[1, 1, len(times[0, 0]) // 2]
            boards = self.stage.carried(other)
            far = [np.linalg.norm(middle.act(b.pose.translation) - [*here, CAMERA.translation[2]]) for b in boards]
            yield from ((boards[k], body) for k in np.argsort(far)[::-1].tolist())

    def scene(self, eye: Pose, boards: Iterable[tuple[Board, Pose]]) -> Array:
        """The light on each pixel of a camera at `eye` in the room, with boards on carriers at poses (3, 3, lines),
        those behind first."""
        image = self._room(eye[1, 1])[0]
        for board, carrier in boards:
            self._draw(image, board, eye, carrier)
        return image

    @cached_property
    def _rays(self) -> tuple[AnyArray, AnyArray]:
        """X/Z and Y/Z of the rays through the points of all pixels (3, 3, h, w)."""
        width, height = self.camera.size
        u, v = (np.arange(-GRID, n + 2 * GRID, GRID, dtype=float) for n in (width, height))
        rays, _ = self.camera.rays(np.stack(np.meshgrid(u, v), -1))
        fine = [(np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in (width, height)]
        along, down = (np.repeat(_staggered(n), FINE) for n in (height, width))
        points = []
        for k in (0, 1):
            lens = RectBivariateSpline(v, u, rays[..., k] / rays[..., 2])
            slope, by_v, by_u = (lens(fine[1], fine[0], *d) for d in ((0, 0), (1, 0), (0, 1)))
            points.append((slope + by_u * along[:, None] + by_v * down).astype(np.float32))
        places = [x.reshape(height, FINE, width, FINE).transpose(1, 3, 0, 2) for x in points]
        order = _went_round(height, width)
        flat = (np.take_along_axis(x.reshape(-1, height, width), order, 0) for x in places)
        a, b = (x.reshape(FINE, FINE, height, width) for x in flat)
        return a, b

    def _draw(self, image: Array, board: Board, eye: Pose, carrier: Pose) -> None:
        """Draw a board over the image; `eye` and `carrier` (3, 3, lines) are where they are when points are exposed."""
        if (found := self._met(board, eye, carrier)) is None:
            return
        window, met, row, column, _ = found
        light = board.picture[np.where(met, row, 0), np.where(met, column, 0)]
        part = image[window]
        part += ((light - part) * met).mean((0, 1))

    def _met(
        self, board: Board, eye: Pose, carrier: Pose
    ) -> tuple[tuple[slice, slice], BoolArray, IntArray, IntArray, AnyArray] | None:
        """The window in which a board can be seen, and which points (3, 3, h, w) in it meet the board, in which row and
        column of its picture, how far along the camera's axis; of one point a pixel (1, 1, h, w) for (1, 1, lines)."""
        there = (carrier @ board.pose).inverse() @ eye
        if (there.translation[..., 2] <= 1e-3).all():
            return None  # its back
        top, bottom, left, right = self._window(board, eye, carrier)
        if top >= bottom or left >= right:
            return None
        o, D = (x[:, :, top:bottom, ..., None].astype(np.float32) for x in (there.translation, there.rotation))
        few = slice(None) if len(eye) == FINE else slice(FINE // 2, FINE // 2 + 1)
        a, b = (x[few, few, top:bottom, left:right] for x in self._rays)
        x, y, z = (D[..., k, 0, :] * a + D[..., k, 1, :] * b + D[..., k, 2, :] for k in range(3))
        ahead = z * np.sign(o[..., 2, :]) < -1e-9
        s = -o[..., 2, :] / np.where(ahead, z, -1.0)
        height, width = board.picture.shape
        column = np.floor((o[..., 0, :] + s * x) / board.size_m[0] * width + 0.5 * width).astype(np.int64)
        row = np.floor(0.5 * height - (o[..., 1, :] + s * y) / board.size_m[1] * height).astype(np.int64)
        met = ahead & (o[..., 2, :] > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return (slice(top, bottom), slice(left, right)), met, row, column, s

    def _window(self, board: Board, eye: Pose, carrier: Pose) -> tuple[int, int, int, int]:
        """The lines and columns in which a board can be seen."""
        width, height = self.camera.size
        corners = []
        # The middle of the exposure, its beginning and its end, where the eye has all three.
        instants = ((1, 1), (1, 2), (1, 0)) if len(eye) == FINE else ((0, 0),)
        for k in (0, height // 2, height - 1):
            for i, j in instants:
                seen = eye[i, j, k].inverse().act(carrier[i, j, k].act(board.corners))
                corners.append(seen)
        points = np.concatenate(corners)
        if (points[:, 2] <= 0.0).all():
            return 0, 0, 0, 0
        if (points[:, 2] <= 0.05).any():
            return 0, height, 0, width
        slopes = points[:, :2] / points[:, 2:]
        if (np.abs(slopes) > 2.0).any():  # beyond any lens of this film, where distortion would fold back
            if (slopes > 2.0).all(0).any() or (slopes < -2.0).all(0).any():
                return 0, 0, 0, 0
            return 0, height, 0, width
        pixels = self.camera.project(points)
        low, high = np.floor(pixels.min(0)).astype(int) - 3, np.ceil(pixels.max(0)).astype(int) + 4
        left, right = np.clip([low[0], high[0]], 0, width).tolist()
        top, bottom = np.clip([low[1], high[1]], 0, height).tolist()
        return top, bottom, left, right

    def _room(self, eye: Pose) -> tuple[Array, Array]:
        """The light of walls, floor and ceiling, by one ray a pixel, and how far along it they are; `eye` (lines,)."""
        a, b = (x[FINE // 2, FINE // 2] for x in self._rays)
        R, T = eye.rotation.astype(np.float32)[..., None], eye.translation.astype(np.float32)[..., None]
        d = [R[:, k, 0] * a + R[:, k, 1] * b + R[:, k, 2] for k in range(3)]
        steep = [np.where(x > 0, np.maximum(x, 1e-6), np.minimum(x, -1e-6)) for x in d]
        to = [(np.where(d[k] > 0, high, low) - T[:, k]) / steep[k]
              for k, (low, high) in enumerate(((-SIDE_M / 2, SIDE_M / 2),) * 2 + ((0.0, HEIGHT_M),))]  # fmt: skip
        s = np.minimum(np.minimum(to[0], to[1]), to[2])
        x, y, z = (T[:, k] + s * d[k] for k in range(3))
        soft = 0.03 * np.sin(5.1 * x + 3.3 * y) + 0.03 * np.sin(4.3 * y - 6.1 * z) + 0.02 * np.sin(11.0 * x + 9.0 * z)
        wall = np.where(to[0] < to[1], 0.55, 0.47) + soft
        floor = 0.30 + soft + 0.04 * np.tanh(8.0 * np.sin(2 * np.pi * x) * np.sin(2 * np.pi * y))
        flat = to[2] <= np.minimum(to[0], to[1])
        light = np.where(flat, np.where(d[2] < 0, floor, 0.75 + soft), wall)
        return np.asarray(light, float), np.asarray(s, float)


def _staggered(count: int) -> Array:
    """By how much the points of each line (count,) are shifted [pixels], within the distance of two points."""
    return np.asarray((np.arange(count) * STAGGER % 1.0 - 0.5) / FINE)


def _went_round(height: int, width: int) -> IntArray:
    """Which place (9, h, w) of each pixel is exposed at each of the instants: these go round from pixel to pixel."""
    places = np.argsort(MAGIC, axis=None)  # in the order of their instants in the magic square
    step = 4 * np.arange(height)[:, None] + 2 * np.arange(width)  # both have no divisor in common with 9
    return np.asarray(places[(MAGIC.reshape(-1, 1, 1) - 1 + step) % MAGIC.size])


def _body(xytheta: Array) -> Pose:
    """Poses in space (...,) of bodies on the floor."""
    c, s, zero = np.cos(xytheta[..., 2]), np.sin(xytheta[..., 2]), np.zeros(xytheta.shape[:-1])
    rotation = np.stack(
        [np.stack([c, -s, zero], -1), np.stack([s, c, zero], -1), np.stack([zero, zero, zero + 1.0], -1)], -2
    )
    return Pose(rotation, np.concatenate([xytheta[..., :2], zero[..., None]], -1))
