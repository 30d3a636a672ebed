"""Cameras: which direction each pixel looks in, and where a point appears.

A point (X, Y, Z) before the camera (Z ahead, X right, Y down) has a = X/Z, b = Y/Z, r^2 = a^2 + b^2, and appears at

    radtan       (k1, k2, p1, p2, [k3, [k4, k5, k6]])
                 s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
                 a' = a s + 2 p1 a b + p2 (r^2 + 2 a^2),  b' = b s + p1 (r^2 + 2 b^2) + 2 p2 a b
    equidistant  (k1, k2, k3, k4)    t' = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8),  t the angle off the axis

    u = fx a' + cx,   v = fy b' + cy;   pixel (0, 0) is the centre of the first pixel (OpenCV, ROS, Kalibr)

Source: OpenCV's calib3d and fisheye models; Kannala, Brandt (2006) for equidistant.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray, s2

STEPS = 20  # of the inversions, which are Newton's: quadratic near the answer
STANDS = 1e-10  # of where a point is: it stands once its step is below that
PIXEL = 1e-3  # how well an inversion must bring a pixel back
GROWS = (
    0.1  # of the area at its centre: a model that spreads the image less than that is near its end, and says nothing
)
NUMBERS = {"radtan": (0, 4, 5, 8), "equidistant": (0, 4)}


@dataclass(frozen=True)
class Camera:
    """A calibrated camera: focal lengths and centre [pixels], a distortion model of NUMBERS with its numbers, and the
    size of its images [pixels], 0 where nobody said. InputError for what can be no camera."""

    focal: tuple[float, float]
    centre: tuple[float, float]
    model: str = "radtan"
    distortion: tuple[float, ...] = ()
    size: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        if self.model not in NUMBERS:
            raise InputError(f"unknown distortion model '{self.model}'; known are {', '.join(NUMBERS)}")
        if len(self.distortion) not in NUMBERS[self.model]:
            wanted = " or ".join(map(str, NUMBERS[self.model]))
            raise InputError(f"{self.model} distortion has {wanted} numbers, found {len(self.distortion)}")
        numbers = (*self.focal, *self.centre, *self.distortion)
        if not np.isfinite(numbers).all() or min(self.focal) <= 0.0:
            raise InputError(f"focal lengths are above 0 and all numbers finite; found {numbers}")

    def longer(self, scale: float) -> "Camera":
        """With focal lengths `scale` times as long."""
        return self if scale == 1.0 else replace(self, focal=(self.focal[0] * scale, self.focal[1] * scale))

    def shifted(self, x: float, y: float) -> "Camera":
        """With its centre [pixels] so much farther right and down."""
        return self if x == y == 0.0 else replace(self, centre=(self.centre[0] + x, self.centre[1] + y))

    def project(self, points: Array) -> Array:
        """Where points (..., 3) in the camera's frame appear (..., 2) [pixels]; NaN for those that it cannot see."""
        a, b, seen = _in_image(self.model, np.asarray(points, float))
        flat = MODELS[self.model](np.stack([a, b], -1), _padded(self.distortion))
        pixels = flat * np.array(self.focal) + np.array(self.centre)
        return np.where(seen[..., None], pixels, np.nan)

    def rays(self, pixels: Array) -> tuple[Array, BoolArray]:
        """The directions (..., 3), of unit length, in which pixels (..., 2) look, and for which of them (...,) there is
        one: beyond the edge of what a distortion model can say there is none. Law: project(rays(p)) = p."""
        wanted = (np.asarray(pixels, float) - np.array(self.centre)) / np.array(self.focal)
        distort, numbers = MODELS[self.model], _padded(self.distortion)
        flat, good = _undistorted(distort, wanted, numbers)
        away = np.abs(distort(flat, numbers) - wanted) * np.array(self.focal)
        good &= (away < PIXEL).all(-1)
        rays = _ray(self.model, np.where(good[..., None], flat, 0.0))
        return rays, good

    def ray_slopes(self, pixels: Array) -> Array:
        """How much the directions turn (..., 2, 2) [rad/pixel], in the axes of `s2`, when pixels move; by differences
        over half a pixel to either side."""
        here, _ = self.rays(pixels)
        basis = np.swapaxes(s2.direction_basis(here), -1, -2)
        columns = [
            (basis @ (self.rays(pixels + step)[0] - self.rays(pixels - step)[0])[..., None])[..., 0]
            for step in 0.5 * np.eye(2)
        ]
        return np.stack(columns, -1)


def _radtan(flat: Array, k: Array) -> Array:
    a, b = flat[..., 0], flat[..., 1]
    square = np.minimum(a * a + b * b, 1e8)
    s = 1.0 + square * (k[0] + square * (k[1] + square * k[4]))
    s = s / (1.0 + square * (k[5] + square * (k[6] + square * k[7])))
    return np.stack(
        [
            a * s + 2.0 * k[2] * a * b + k[3] * (square + 2.0 * a * a),
            b * s + k[2] * (square + 2.0 * b * b) + 2.0 * k[3] * a * b,
        ],
        -1,
    )


def _equidistant(flat: Array, k: Array) -> Array:
    """Of (t cos, t sin), t the angle off the axis."""
    square = np.minimum(np.sum(flat**2, -1, keepdims=True), 40.0)
    return np.asarray(flat * (1.0 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3])))))


MODELS: dict[str, Callable[[Array, Array], Array]] = {"radtan": _radtan, "equidistant": _equidistant}


def _padded(distortion: tuple[float, ...]) -> Array:
    return np.array([*distortion, *([0.0] * (8 - len(distortion)))])


def _in_image(model: str, points: Array) -> tuple[Array, Array, BoolArray]:
    """Points before distortion, and which can be seen at all."""
    x, y, z = np.moveaxis(points, -1, 0)
    if model == "radtan":
        seen = z > 1e-9
        depth = np.where(seen, z, 1.0)
        return x / depth, y / depth, seen
    off = np.hypot(x, y)
    angle = np.arctan2(off, z)
    share = np.where(off > 0.0, angle / np.where(off > 0.0, off, 1.0), 0.0)
    return x * share, y * share, angle < np.pi


def _ray(model: str, flat: Array) -> Array:
    if model == "radtan":
        return s2.of(np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], -1))
    angle = np.linalg.norm(flat, axis=-1, keepdims=True)
    return np.concatenate([flat * np.sinc(angle / np.pi), np.cos(angle)], -1)


def _undistorted(distort: Callable[[Array, Array], Array], wanted: Array, numbers: Array) -> tuple[Array, BoolArray]:
    """Newton's method for distort(x) = wanted, from x = wanted, each until it stands; and where the model still grows
    outwards there."""
    goal = wanted.reshape(-1, 2)
    flat, good = goal.copy(), np.ones(len(goal), bool)
    moving = np.arange(len(goal))
    for _ in range(STEPS):
        if not len(moving):
            break
        here = flat[moving]
        a, b, c, d = _slopes(distort, here, numbers)
        area = a * d - b * c
        good[moving] = area > GROWS
        off = goal[moving] - distort(here, numbers)
        inside = area > 1e-9
        area = np.where(inside, area, 1.0)
        solved = np.stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]], -1) / area[:, None]
        move = np.where(inside[:, None], solved, off)
        length = np.linalg.norm(move, axis=-1)
        flat[moving] = here + move * np.minimum(1.0, 0.5 / np.maximum(length, 1e-12))[:, None]
        moving = moving[~(length < STANDS * (1.0 + np.abs(here).max(-1)))]
    return flat.reshape(wanted.shape), good.reshape(wanted.shape[:-1])


def _slopes(distort: Callable[[Array, Array], Array], flat: Array, numbers: Array) -> tuple[Array, Array, Array, Array]:
    """The derivatives (n,) of a distortion, row by row, by differences."""
    step = 1e-6
    one, other = ((distort(flat + d, numbers) - distort(flat - d, numbers)) / (2.0 * step) for d in step * np.eye(2))
    return one[:, 0], other[:, 0], one[:, 1], other[:, 1]
