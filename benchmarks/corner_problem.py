"""A camera is carried round a room and looks at the walls, on which tags hang: as plain arrays, with a neutral cost.

Each frame shows up to three tags, all four corners as directions with a noise of half a milliradian. Unknown are the
poses of all frames and of all tags but the first. Starts are off by some centimetres and degrees, as poses from single
images are. The cost is half the squared angles between what was seen and what is expected, in sigmas.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

SIGMA = 5e-4  # [rad] of each corner, along either axis
TAG_M = 0.2
ROOM_M, HIGH_M = 10.0, 2.5
VISIBLE_M, WIDE_RAD = 7.0, 0.6
SHOWN = 3  # tags in a frame at most
OFF = {"frames": (0.03, 0.02), "tags": (0.05, 0.05)}  # [m], [rad] of the starts


@dataclass(frozen=True)
class Poses:
    """Positions T (n, 3) and rotations R (n, 3, 3) in the world."""

    T: np.ndarray
    R: np.ndarray

    def off(self, rng: np.random.Generator, metres: float, radians: float) -> "Poses":
        """The same, each moved and turned at random."""
        turn = Rotation.from_rotvec(rng.normal(0.0, radians, self.T.shape)).as_matrix()
        return Poses(self.T + rng.normal(0.0, metres, self.T.shape), self.R @ turn)


@dataclass(frozen=True)
class Problem:
    """Row k: tag `tag[k]` seen from frame `frame[k]` as the unit vectors `rays[k]` (4, 3)."""

    frame: np.ndarray
    tag: np.ndarray
    rays: np.ndarray
    frames: Poses
    tags: Poses

    @property
    def places(self) -> np.ndarray:
        """The corners in the frame of a tag."""
        return 0.5 * TAG_M * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])


def problem(frames: int, tags: int, seed: int) -> tuple[Problem, Poses]:
    """A problem with its starts, and where the tags are."""
    rng = np.random.default_rng(seed)
    walls = _on_walls(rng, tags)
    t = np.linspace(0.0, 0.02 * np.pi * frames**0.7, frames)
    away = 1.5 + 0.8 * np.sin(0.37 * t)
    T = np.stack([away * np.cos(t), away * np.sin(t), 1.2 + 0.3 * np.sin(0.83 * t)], -1)
    look = np.stack([np.cos(1.07 * t), np.sin(1.07 * t), 0.2 * np.sin(0.5 * t)], -1)
    ways = Poses(T, _looking(look))
    frame, tag = _seen(ways, walls)
    shown, frame = np.unique(frame, return_inverse=True)  # what shows nothing, or is not shown, is left out
    kept, tag = np.unique(tag, return_inverse=True)
    ways, walls = Poses(ways.T[shown], ways.R[shown]), Poses(walls.T[kept], walls.R[kept])
    found = Problem(frame, tag, np.zeros((len(frame), 4, 3)), ways, walls)
    rays = _perturbed(rng, expected(found, ways, walls))
    starts = walls.off(rng, *OFF["tags"])
    starts.T[0], starts.R[0] = walls.T[0], walls.R[0]
    return Problem(frame, tag, rays, ways.off(rng, *OFF["frames"]), starts), walls


def expected(of: Problem, frames: Poses, tags: Poses) -> np.ndarray:
    """Unit vectors (rows, 4, 3) to the corners from the frames."""
    there = of.places @ np.swapaxes(tags.R[of.tag], 1, 2) + tags.T[of.tag, None]
    seen = (there - frames.T[of.frame, None]) @ frames.R[of.frame]
    return np.asarray(seen / np.linalg.norm(seen, axis=-1, keepdims=True))


def cost(of: Problem, frames: Poses, tags: Poses) -> float:
    """The neutral cost."""
    h = expected(of, frames, tags)
    sine = np.linalg.norm(np.cross(of.rays, h), axis=-1)
    return float(0.5 * np.sum((np.arctan2(sine, np.sum(of.rays * h, -1)) / SIGMA) ** 2))


def _on_walls(rng: np.random.Generator, count: int) -> Poses:
    wall = rng.integers(0, 4, count)
    along, up = rng.uniform(-0.45 * ROOM_M, 0.45 * ROOM_M, count), rng.uniform(0.3, HIGH_M, count)
    to = 0.5 * np.pi * wall
    out = np.stack([np.cos(to), np.sin(to), np.zeros(count)], -1)
    side = np.stack([-np.sin(to), np.cos(to), np.zeros(count)], -1)
    T = 0.5 * ROOM_M * out + along[:, None] * side + up[:, None] * np.array([0.0, 0.0, 1.0])
    return Poses(T, np.stack([-side, np.broadcast_to([0.0, 0.0, 1.0], T.shape), -out], -1))


def _looking(along: np.ndarray) -> np.ndarray:
    ahead = along / np.linalg.norm(along, axis=1, keepdims=True)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(ahead, right), ahead], -1)


def _seen(frames: Poses, tags: Poses) -> tuple[np.ndarray, np.ndarray]:
    frame, tag = [], []
    for n, (T, R) in enumerate(zip(frames.T, frames.R, strict=True)):
        to = (tags.T - T) @ R
        away = np.linalg.norm(to, axis=1)
        facing = np.sum((T - tags.T) * tags.R[:, :, 2], 1) > 0.2 * away
        fits = (to[:, 2] > np.cos(WIDE_RAD) * away) & (away < VISIBLE_M) & facing
        near = np.flatnonzero(fits)[np.argsort(away[fits])[:SHOWN]]
        frame += [n] * len(near)
        tag += near.tolist()
    return np.array(frame), np.array(tag)


def _perturbed(rng: np.random.Generator, rays: np.ndarray) -> np.ndarray:
    turned = rays + rng.normal(0.0, SIGMA, rays.shape)  # what lies along the ray does not show
    return np.asarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))
