"""Seeded landmark SLAM problems as plain arrays, and the neutral cost that judges every solver's answer.

Several robots drive about one square world of landmarks. Step for step a robot measures its motion (relative pose), and
in every pose its nearest landmarks (position in the body), farther than 1.5 m. Residuals and noise:

    odometry  [zT - R1'(T2 - T1); Log((R1'R2)' zR)],  sigma_T [m], sigma_R [rad]
    sighting  z - R'(p - T),                          sigma_P [m]

The start is dead reckoning: each robot's odometry from its true first pose, each landmark where it was first seen. The
first pose of the first robot is held fixed.
"""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from peers.native import Flat

SIGMA_T, SIGMA_R, SIGMA_P = 0.02, 0.0005, 0.1
NEAREST_M = 1.5
STYLES = ("lawn_mower", "random_walk")


@dataclass(frozen=True)
class Size:
    """How much of everything: poses are for each robot, sightings for each pose."""

    robots: int
    poses: int
    landmarks: int
    sightings: int


SIZES = {
    "small": Size(robots=3, poses=100, landmarks=60, sightings=4),
    "medium": Size(robots=5, poses=2_000, landmarks=500, sightings=4),
    "large": Size(robots=10, poses=10_000, landmarks=5_000, sightings=5),
}


@dataclass(frozen=True, eq=False)
class Problem:
    """A problem in arrays. `d` is 2 or 3; poses are numbered robot after robot.

    Odometry k goes from pose `odometry_from[k]` to the next one; sighting k is of landmark `seen[k]` from pose
    `seen_from[k]`. Rotations are matrices (m, d, d). `start_*` is where every solver begins.
    """

    robots: np.ndarray  # (poses,) the robot of each pose, from 0
    odometry_from: np.ndarray  # (m,)
    odometry_T: np.ndarray  # (m, d)
    odometry_R: np.ndarray  # (m, d, d)
    seen_from: np.ndarray  # (s,)
    seen: np.ndarray  # (s,)
    sightings: np.ndarray  # (s, d)
    start_T: np.ndarray  # (poses, d)
    start_R: np.ndarray  # (poses, d, d)
    start_P: np.ndarray  # (landmarks, d)

    @property
    def dim(self) -> int:
        """2 or 3."""
        return self.start_T.shape[1]

    def save(self, path: Path) -> None:
        """Write it as one file."""
        np.savez(path, **{f.name: getattr(self, f.name) for f in fields(self)})

    def save_flat(self, path: Path) -> None:
        """Write it for the programs in C++."""
        steps = len(self.odometry_from)
        Flat(
            robots=int(self.robots.max()) + 1,
            step_from=self.odometry_from,
            step_to=self.odometry_from + 1,
            step_T=self.odometry_T,
            step_R=self.odometry_R,
            sigma_T=np.full(steps, SIGMA_T),
            sigma_R=np.full(steps, SIGMA_R),
            seen_from=self.seen_from,
            seen=self.seen,
            sightings=self.sightings,
            sigma_P=SIGMA_P,
            T=self.start_T,
            R=self.start_R,
            P=self.start_P,
        ).save(path)

    @classmethod
    def load(cls, path: Path) -> "Problem":
        """Read it back."""
        with np.load(path) as file:
            return cls(**{f.name: file[f.name] for f in fields(cls)})


@dataclass(frozen=True, eq=False)
class Estimate:
    """Poses (poses, d), (poses, d, d) and landmarks (landmarks, d)."""

    T: np.ndarray
    R: np.ndarray
    P: np.ndarray

    def save(self, path: Path) -> None:
        """Write it as plain numbers: all T, all R, all P."""
        np.concatenate([self.T.ravel(), self.R.ravel(), self.P.ravel()]).tofile(path)

    @classmethod
    def load(cls, path: Path, problem: Problem) -> "Estimate":
        """Read it back."""
        numbers, d, n = np.fromfile(path), problem.dim, len(problem.robots)
        T, R, P = np.split(numbers, [n * d, n * d * (d + 1)])
        return cls(T.reshape(n, d), R.reshape(n, d, d), P.reshape(-1, d))


def generate(size: Size, dim: int, style: str, seed: int) -> Problem:
    """The problem of a size, dimension, style of driving and seed: the same arrays each time."""
    rng = np.random.default_rng([seed, dim, STYLES.index(style), size.poses])
    side = np.sqrt(20.0 * size.landmarks)
    P = rng.uniform(0.0, 1.0, (size.landmarks, dim)) * side
    if dim == 3:
        P[:, 2] = rng.uniform(-3.0, 3.0, size.landmarks)
    ways = [_drive(rng, style, robot, size.poses, side) for robot in range(size.robots)]
    T = np.concatenate([_heights(rng, way[0], dim) for way in ways])
    R = np.concatenate([_attitudes(rng, way[1], dim) for way in ways])
    robots = np.repeat(np.arange(size.robots), size.poses)

    first = np.flatnonzero(robots[1:] == robots[:-1])
    odometry_T = _rotate_back(R[first], T[first + 1] - T[first]) + rng.normal(0.0, SIGMA_T, (len(first), dim))
    noise = rng.normal(0.0, SIGMA_R, (len(first), 1 if dim == 2 else 3))
    odometry_R = np.swapaxes(R[first], 1, 2) @ R[first + 1] @ exp(noise)

    seen_from, seen = _sight(T, P, size.sightings)
    clean = _rotate_back(R[seen_from], P[seen] - T[seen_from])
    sightings = clean + rng.normal(0.0, SIGMA_P, clean.shape)

    start_T, start_R = _dead_reckoning(T, R, robots, first, odometry_T, odometry_R)
    known, where = np.unique(seen, return_index=True)
    kept = np.full(size.landmarks, -1)
    kept[known] = np.arange(len(known))  # landmarks that nobody saw are left out
    start_P = start_T[seen_from[where]] + (start_R[seen_from[where]] @ sightings[where][..., None])[..., 0]
    return Problem(robots, first, odometry_T, odometry_R, seen_from, kept[seen], sightings, start_T, start_R, start_P)


def cost(problem: Problem, at: Estimate) -> float:
    """chi2: the sum of squared whitened residuals, without a factor 1/2."""
    a, b = problem.odometry_from, problem.odometry_from + 1
    back = np.swapaxes(at.R[a], 1, 2)
    of_T = problem.odometry_T - _rotate_back(at.R[a], at.T[b] - at.T[a])
    of_R = log(np.swapaxes(back @ at.R[b], 1, 2) @ problem.odometry_R)
    of_P = problem.sightings - _rotate_back(at.R[problem.seen_from], at.P[problem.seen] - at.T[problem.seen_from])
    squares = [(of_T / SIGMA_T) ** 2, (of_R / SIGMA_R) ** 2, (of_P / SIGMA_P) ** 2]
    return float(sum(np.sum(s) for s in squares))


def exp(w: np.ndarray) -> np.ndarray:
    """Rotations (m, d, d) of angles (m, 1) or rotation vectors (m, 3)."""
    angle = np.linalg.norm(w, axis=1) if w.shape[1] == 3 else w[:, 0]
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    if w.shape[1] == 1:
        return np.block([[c, -s], [s, c]])
    axis = w / np.maximum(angle, 1e-300)[:, None]
    K = np.zeros((len(w), 3, 3))
    K[:, [2, 0, 1], [1, 2, 0]], K[:, [1, 2, 0], [2, 0, 1]] = axis, -axis
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def log(R: np.ndarray) -> np.ndarray:
    """Angles (m, 1) or rotation vectors (m, 3) of rotations by less than half a turn."""
    if R.shape[1] == 2:
        return np.arctan2(R[:, 1, 0], R[:, 0, 0])[:, None]
    v = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], -1)
    sine, cosine = np.linalg.norm(v, axis=1), 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0)
    return v * (np.arctan2(sine, cosine) / np.where(sine > 0.0, sine, 1.0))[:, None]


# --- the world ----------------------------------------------------------------------------------------------------


def _drive(rng: np.random.Generator, style: str, robot: int, poses: int, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 2) and headings (n,) of a way in steps of about one metre."""
    if style == "lawn_mower":
        way = _lawn_mower(poses, side)
        turned = [way, way[:, ::-1], side - way, (side - way)[:, ::-1]][robot % 4]
        places = turned + rng.uniform(-2.0, 2.0, 2)
        steps = np.diff(places, axis=0, append=2.0 * places[-1:] - places[-2:-1])
        return places, np.arctan2(steps[:, 1], steps[:, 0])
    places, headings = np.empty((poses, 2)), np.empty(poses)
    place, heading = rng.uniform(0.2, 0.8, 2) * side, rng.uniform(-np.pi, np.pi)
    for n, turn in enumerate(rng.normal(0.0, 0.15, poses)):
        places[n], headings[n] = place, heading
        if ((place < 0.0) | (place > side)).any():  # back towards the middle
            wanted = np.arctan2(*(0.5 * side - place)[::-1])
            turn = np.clip((wanted - heading + np.pi) % (2.0 * np.pi) - np.pi, -0.3, 0.3)
        heading += turn
        place = place + np.array([np.cos(heading), np.sin(heading)])
    return places, headings


def _lawn_mower(poses: int, side: float) -> np.ndarray:
    """Rows up and down that fill the square, in equal steps."""
    rows = max(1, round((poses - side) / side))
    row = np.repeat(np.arange(rows + 1), 2)
    corners = np.stack([np.where((np.arange(2 * rows + 2) + 1) // 2 % 2 == 0, 0.0, side), row * side / rows], -1)
    reach = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    at = np.linspace(0.0, reach[-1], poses)
    return np.stack([np.interp(at, reach, corners[:, axis]) for axis in (0, 1)], -1)


def _heights(rng: np.random.Generator, places: np.ndarray, dim: int) -> np.ndarray:
    if dim == 2:
        return places
    t = np.arange(len(places)) + rng.uniform(0.0, 100.0)
    return np.column_stack([places, 2.0 * np.sin(0.05 * t)])


def _attitudes(rng: np.random.Generator, headings: np.ndarray, dim: int) -> np.ndarray:
    if dim == 2:
        return exp(headings[:, None])
    t = np.arange(len(headings)) + rng.uniform(0.0, 100.0)
    zero = np.zeros_like(headings)
    yaw = exp(np.stack([zero, zero, headings], -1))
    return yaw @ exp(np.stack([0.1 * np.sin(0.11 * t), 0.15 * np.sin(0.07 * t), zero], -1))


def _sight(T: np.ndarray, P: np.ndarray, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """Of every pose the nearest landmarks that are not too near: (poses' numbers, landmarks' numbers)."""
    distance, which = cKDTree(P).query(T, wanted + 3)
    far = distance > NEAREST_M
    chosen = far & (np.cumsum(far, axis=1) <= wanted)
    return np.nonzero(chosen)[0], which[chosen]


def _dead_reckoning(
    T: np.ndarray, R: np.ndarray, robots: np.ndarray, first: np.ndarray, step_T: np.ndarray, step_R: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    start_T, start_R = T.copy(), R.copy()
    for k, pose in enumerate(first):
        start_T[pose + 1] = start_T[pose] + start_R[pose] @ step_T[k]
        start_R[pose + 1] = start_R[pose] @ step_R[k]
    if R.shape[1] == 3:  # rounding piles up over long ways
        u, _, v = np.linalg.svd(start_R)
        start_R = u @ v
    else:
        start_R /= np.linalg.norm(start_R[:, :, :1], axis=1, keepdims=True)
    return start_T, start_R


def _rotate_back(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.einsum("nij,ni->nj", R, v)
