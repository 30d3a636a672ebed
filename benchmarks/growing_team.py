"""A made-up team that can grow without end: every robot mows a cell of its own in one wide field.

Cells lie in a square grid and are as large as a robot's log can cover twice, so the field grows with the team. Robots
see landmarks up to 8 m away, also beyond the edge of their cell: that is what neighbours share; and each other, where
they meet. A robot's log needs only the cells around its own, so that logs are made one by one, each for itself.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from teamslam.geometry import Pose, concatenate
from teamslam.model import Dataset, is_landmark
from teamslam.sim import Arena, Odometry, Robot, Sensor, World, observe
from teamslam.sim.motion import lawn_mower
from teamslam.wire.pieces import write_pieces

STEP_M = 0.8
SIDE_M = 100.0  # of the cell of a log of 10,000 poses
AREA_M2 = 25.0  # for each landmark
SEES = Robot(
    odometry=Odometry(sigma_m=0.02, sigma_rad=0.002),
    landmarks=Sensor("point", sigma_m=0.1, range_m=8.0),
    robots=Sensor("relative_pose", sigma_m=0.05, sigma_rad=0.02, range_m=8.0, every=5),
)
ONLY_MOVES = replace(SEES, landmarks=None, robots=None)


@dataclass(frozen=True)
class Team:
    """`robots` with logs of `poses` each."""

    robots: int
    poses: int
    seed: int = 1

    @cached_property
    def side_m(self) -> float:
        """Of a cell."""
        return SIDE_M * float(np.sqrt(self.poses / 1e4))

    @property
    def columns(self) -> int:
        """Cells in a row of the grid."""
        return int(np.ceil(np.sqrt(self.robots)))

    def centre(self, robot: int) -> np.ndarray:
        """The middle (2,) of a robot's cell."""
        row, column = divmod(robot - 1, self.columns)
        return self.side_m * np.array([column, row], float)

    def around(self, robot: int) -> list[int]:
        """The robots of the cells that touch a robot's, its own first."""
        row, column = divmod(robot - 1, self.columns)
        near = [
            r * self.columns + c + 1
            for r in (row - 1, row, row + 1)
            for c in (column - 1, column, column + 1)
            if r >= 0 and 0 <= c < self.columns
        ]
        return [robot, *(other for other in near if other != robot and other <= self.robots)]

    def way(self, robot: int) -> Pose:
        """A robot's true poses."""
        rng = np.random.default_rng([self.seed, 0, robot])
        track = lawn_mower(1, self.poses, STEP_M, Arena(self.side_m, 2.0), rng)[0]
        turn = Pose.from_xytheta(np.array([0.0, 0.0, 0.5 * np.pi * rng.integers(4)]))
        return Pose(np.eye(2), self.centre(robot)) @ (turn @ Pose.from_xytheta(track))

    def landmarks(self, robot: int) -> Pose:
        """Those of a robot's cell; they are as many in each, and numbered cell by cell."""
        rng = np.random.default_rng([self.seed, 1, robot])
        count = max(1, round(self.side_m**2 / AREA_M2))
        places = self.centre(robot) + self.side_m * rng.uniform(-0.5, 0.5, (count, 2))
        return Pose.from_xytheta(np.column_stack([places, np.zeros(count)]))

    def log(self, robot: int) -> Dataset:
        """What one robot measures."""
        near = self.around(robot)
        cells = [self.landmarks(other) for other in near]
        count = len(cells[0])
        number = np.concatenate([(other - 1) * count + np.arange(count) for other in near])
        world = World({other: self.way(other) for other in near}, concatenate(cells))
        kinds = {other: SEES if other == robot else ONLY_MOVES for other in near}
        seen = observe(world, kinds, self.seed).of_robot(robot)
        tables = []
        for table in seen.tables:
            keys = table.keys.copy()
            marks = is_landmark(keys)
            keys[marks] = number[keys[marks]]
            tables.append(replace(table, keys=keys))
        return replace(seen, robots=dict.fromkeys(range(1, self.robots + 1), 2), tables=tuple(tables), truth=None)


def write_log(task: tuple[Team, int, Path]) -> Path:
    """A robot's log as a file of its own, made unless it is there."""
    team, robot, folder = task
    folder = folder / f"robot_{robot}"
    if found := sorted(folder.glob("*.piece")):
        return found[0]
    return write_pieces([team.log(robot)], folder)[0]
