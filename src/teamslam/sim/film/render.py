"""What a camera sees: for each point of the image the first surface on its ray.

The rays go backwards through the lens, distortion and all, so nothing is approximated but by the number of points,
FINE x FINE a pixel, each with its third of the exposure (`shutter`). What a point sees of a board is the mean over its
patch of it (`patches`). The room itself is drawn by one ray a pixel, as its pattern is soft.

    board's frame:   o + s d,   with o the eye and d the ray there;   it is met at s = -o_z / d_z
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline

from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import AnyArray, Array, BoolArray, Pose
from teamslam.sim.film.boards import Board
from teamslam.sim.film.patches import light_of
from teamslam.sim.film.shutter import FINE, THIRDS, Shutter
from teamslam.sim.film.stage import CAMERA, HEIGHT_M, SIDE_M, Stage

GRID = 8  # pixels between those whose rays are computed; a spline gives the others
MIDDLE = FINE // 2  # of the points of a pixel, and of the thirds of the exposure


@dataclass(frozen=True, eq=False)
class Renderer:
    """Draws what the camera of one robot sees on a stage."""

    stage: Stage
    camera: Camera
    shutter: Shutter

    def image(self, robot: int, middle_s: float) -> AnyArray:
        """The light (FINE h, FINE w) on each point, 0 to about 1, in an image whose middle line is exposed about
        `middle_s`."""
        return self.scene(self._eye(robot, middle_s), self._before(robot, middle_s))

    def scene(self, eye: Pose, boards: Iterable[tuple[Board, Pose]]) -> AnyArray:
        """The light on each point of a camera at `eye` in the room, with boards on carriers at poses (3, lines), those
        behind first."""
        width, height = self.camera.size
        points = np.empty((FINE, FINE, height, width), np.float32)
        points[:] = self._room(eye[MIDDLE])[0]
        for board, carrier in boards:
            self._draw(points, board, eye, carrier)
        return points.transpose(2, 0, 3, 1).reshape(FINE * height, FINE * width)

    def depth(self, robot: int, middle_s: float) -> Array:
        """How far along the camera's axis (h, w) [m] the first surface is, each line at the middle of its exposure."""
        eye = self._eye(robot, middle_s)
        depth = self._room(eye[MIDDLE])[1]
        for board, carrier in self._before(robot, middle_s):
            if (seen := self._seen(board, eye, carrier)) is not None:
                there, window = seen
                a, b = (x[MIDDLE, MIDDLE][window] for x in self._rays)
                x, y, s, ahead = _met(there[MIDDLE, window[0]], a, b)
                half = 0.5 * board.size_m[0], 0.5 * board.size_m[1]
                part = depth[window]
                met = ahead & (np.abs(x) < half[0]) & (np.abs(y) < half[1])
                part[met] = s[met]
        return depth

    def _eye(self, robot: int, middle_s: float) -> Pose:
        times = self.shutter.times(middle_s, self.camera.size[1])
        return _body(self.stage.ways[robot].at(times)) @ CAMERA

    def _before(self, robot: int, middle_s: float) -> Iterator[tuple[Board, Pose]]:
        """All boards that a robot may see, on carriers at poses (3, lines), those behind first."""
        times = self.shutter.times(middle_s, self.camera.size[1])
        yield from ((board, Pose.identity(3, times.shape)) for board in self.stage.hanging)
        others = [k for k in range(len(self.stage.ways)) if k != robot]
        here = self.stage.ways[robot].at(np.array(middle_s))[:2]
        for other in sorted(
            others, key=lambda k: -np.linalg.norm(self.stage.ways[k].at(np.array(middle_s))[:2] - here)
        ):
            body = _body(self.stage.ways[other].at(times))
            middle = body[MIDDLE, times.shape[1] // 2]
            boards = self.stage.carried(other)
            far = [np.linalg.norm(middle.act(b.pose.translation) - [*here, CAMERA.translation[2]]) for b in boards]
            yield from ((boards[k], body) for k in np.argsort(far)[::-1].tolist())

    @cached_property
    def _rays(self) -> tuple[AnyArray, AnyArray]:
        """X/Z and Y/Z of the rays through the points of all pixels (3, 3, h, w)."""
        width, height = self.camera.size
        u, v = (np.arange(-GRID, n + 2 * GRID, GRID, dtype=float) for n in (width, height))
        rays, _ = self.camera.rays(np.stack(np.meshgrid(u, v), -1))
        fine = [(np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in (width, height)]
        points = []
        for k in (0, 1):
            slopes = RectBivariateSpline(v, u, rays[..., k] / rays[..., 2])(fine[1], fine[0]).astype(np.float32)
            points.append(slopes.reshape(height, FINE, width, FINE).transpose(1, 3, 0, 2).copy())
        return points[0], points[1]

    def _draw(self, points: AnyArray, board: Board, eye: Pose, carrier: Pose) -> None:
        """Draw a board over the points; `eye` and `carrier` (3, lines) are where they are in each third."""
        if (seen := self._seen(board, eye, carrier)) is None:
            return
        there, window = seen
        lines = there[:, window[0]]
        a, b = (x[:, :, window[0], window[1]] for x in self._rays)
        x, y, _, ahead = _met(lines[THIRDS], a, b)
        rows, columns = board.picture.shape
        per_m = np.float32(columns / board.size_m[0]), np.float32(rows / board.size_m[1])
        wide, high = _swept(lines, a, b)
        half = np.float32(0.5)
        light, share = light_of(
            board.picture, x * per_m[0] + half * columns, half * rows - y * per_m[1], wide * per_m[0], high * per_m[1]
        )
        part = points[:, :, window[0], window[1]]
        part += np.where(ahead, light - share * part, 0.0)

    def _seen(self, board: Board, eye: Pose, carrier: Pose) -> tuple[Pose, tuple[slice, slice]] | None:
        """The eye in the frame of a board (3, lines), and the window in which the board can be seen; None where it
        cannot."""
        there = (carrier @ board.pose).inverse() @ eye
        if (there.translation[..., 2] <= 1e-3).all():
            return None  # its back
        top, bottom, left, right = self._window(board, eye, carrier)
        if top >= bottom or left >= right:
            return None
        return there, (slice(top, bottom), slice(left, right))

    def _window(self, board: Board, eye: Pose, carrier: Pose) -> tuple[int, int, int, int]:
        """The lines and columns in which a board can be seen."""
        width, height = self.camera.size
        corners = [eye[i, k].inverse().act(carrier[i, k].act(board.corners))
                   for i in range(FINE) for k in (0, height // 2, height - 1)]  # fmt: skip
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
        spare = np.ceil(2.0 + 0.5 * np.ptp(pixels.reshape(FINE, -1, 2), 0).max(0)).astype(int)  # the thirds' own ends
        low, high = np.floor(pixels.min(0)).astype(int) - spare, np.ceil(pixels.max(0)).astype(int) + spare + 1
        left, right = np.clip([low[0], high[0]], 0, width).tolist()
        top, bottom = np.clip([low[1], high[1]], 0, height).tolist()
        return top, bottom, left, right

    def _room(self, eye: Pose) -> tuple[Array, Array]:
        """The light of walls, floor and ceiling, by one ray a pixel, and how far along it they are; `eye` (lines,)."""
        a, b = (x[MIDDLE, MIDDLE] for x in self._rays)
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


def _met(there: Pose, a: AnyArray, b: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray, BoolArray]:
    """Where rays (.., h, w) from an eye that is there in a board's frame (.., h) meet its plane, x and y [m], how far
    along them, and which do, from the front."""
    o, d = _directions(there, a, b)
    height = o[2]
    ahead = (d[2] < -1e-9) & (height > 0.0)
    s = -height / np.where(ahead, d[2], np.float32(-1.0))
    return o[0] + s * d[0], o[1] + s * d[1], s, ahead


def _directions(there: Pose, a: AnyArray, b: AnyArray) -> tuple[list[AnyArray], list[AnyArray]]:
    o, R = (x.astype(np.float32)[..., None] for x in (there.translation, there.rotation))
    d = [R[..., k, 0, :] * a + R[..., k, 1, :] * b + R[..., k, 2, :] for k in range(3)]
    return [o[..., k, :] for k in range(3)], d


def _swept(there: Pose, a: AnyArray, b: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The width and the height (h, w) [m] of the patch of a board that each point of a pixel sees: what its ray sweeps
    in the plane over a third of a pixel both ways and over a third of the exposure; `there` is (3, h)."""
    middle = a[MIDDLE, MIDDLE], b[MIDDLE, MIDDLE]
    s = _met(there[MIDDLE], *middle)[2]
    _, d = _directions(there[MIDDLE], *middle)
    steep = np.where(d[2] < -1e-9, d[2], np.float32(-1.0))
    first, last = _met(there[0], *middle), _met(there[-1], *middle)
    sides = [[0.5 * (last[k] - first[k]) for k in range(2)]]
    R = there[MIDDLE].rotation.astype(np.float32)[..., None]
    for p, q in (((MIDDLE, 0), (MIDDLE, -1)), ((0, MIDDLE), (-1, MIDDLE))):
        by_a, by_b = (0.5 * (slopes[q] - slopes[p]) for slopes in (a, b))
        step = [R[:, k, 0] * by_a + R[:, k, 1] * by_b for k in range(3)]
        sides.append([s * (step[k] - d[k] * step[2] / steep) for k in range(2)])
    wide, high = (np.sqrt(sum(side[k] ** 2 for side in sides)) for k in range(2))
    return wide, high


def _body(xytheta: Array) -> Pose:
    """Poses in space (...,) of bodies on the floor."""
    c, s, zero = np.cos(xytheta[..., 2]), np.sin(xytheta[..., 2]), np.zeros(xytheta.shape[:-1])
    rotation = np.stack(
        [np.stack([c, -s, zero], -1), np.stack([s, c, zero], -1), np.stack([zero, zero, zero + 1.0], -1)], -2
    )
    return Pose(rotation, np.concatenate([xytheta[..., :2], zero[..., None]], -1))
