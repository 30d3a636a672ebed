"""Made-up worlds: where everything truly is."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import landmark_key, pose_key
from teamslam.sim.motion import MOVES, PATHS, Arena


@dataclass(frozen=True, eq=False)
class World:
    """The truth: the poses (n,) of each robot at common instants, `period_s` [s] apart, and the landmarks (k,).

    Landmarks are poses; sensors that see points use their positions. Their dimension, 2 or 3, is that of the world.
    """

    ways: dict[int, Pose]
    landmarks: Pose
    period_s: float = 1.0

    @property
    def dim(self) -> int:
        """2 where there is no height at all, else 3."""
        return self.landmarks.dim

    @cached_property
    def pose_keys(self) -> dict[int, IntArray]:
        """The keys of each robot's poses, in time order; ticks are microseconds."""
        return {
            robot: pose_key(robot, np.round(np.arange(len(way)) * self.period_s * 1e6).astype(np.int64))
            for robot, way in self.ways.items()
        }

    @cached_property
    def landmark_keys(self) -> IntArray:
        """The keys of the landmarks: 0, 1, 2, ..."""
        return landmark_key(np.arange(len(self.landmarks)))


def scattered_landmarks(count: int, dim: int, arena: Arena, rng: np.random.Generator) -> Pose:
    """Landmarks spread evenly over the arena, turned at random."""
    across = rng.uniform(-0.5, 0.5, (count, 2)) * arena.side_m
    height = rng.uniform(0.0, arena.height_m, (count, dim - 2))
    return Pose.scattered(np.concatenate([across, height], -1), rng)


def ways(path: str, dims: dict[int, int], poses: int, step_m: float, arena: Arena, seed: list[int]) -> dict[int, Pose]:
    """Each robot's poses along a row of PATHS; robots of dimension 3 fly over the track of their ground twin."""
    tracks: Array = PATHS[path](len(dims), poses, step_m, arena, np.random.default_rng([*seed, 0]))
    return {
        robot: MOVES[dim](track, arena.height_m, np.random.default_rng([*seed, 1, robot]))
        for (robot, dim), track in zip(dims.items(), tracks, strict=True)
    }
