"""The paper's simulation (section 3.1): three robots drive among three landmarks.

Landmarks are 2 m above the ground, sensors 1 m (eq. 16); a robot sees landmarks and other robots within 3 m, at each of
its poses, with one standard deviation for all numbers of a sighting and one for all of an odometry step (metres and
radians alike). The paper gives neither its trajectories nor its landmarks, and does not say what its two scenarios
leave out. Here the robots drive side by side, round and round along arcs of eq. (15), and

    sufficient   keeps every sighting in range
    minimum      keeps each robot's first and last sighting of each landmark, and one sighting of a robot by another for
                 the pairs 1-2 and 2-3: about the least that fixes the map
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import BoolArray, Pose
from teamslam.model import Dataset, Table, robot_of
from teamslam.model.keys import MAX_INDEX
from teamslam.sim.motion import drive
from teamslam.sim.scenario import Robot, observe
from teamslam.sim.sense import Odometry, Sensor
from teamslam.sim.world import World

SCENARIOS = ("minimum", "sufficient")
NOISE_LEVELS = ((0.1, 0.2), (0.2, 0.3), (0.3, 0.4))
"""(sigma_observation, sigma_odometry) of the rows of Tables 1 and 2; metres and radians."""

RANGE_M, SENSOR_HEIGHT_M, LANDMARK_HEIGHT_M = 3.0, 1.0, 2.0
# Trajectories and landmarks are not published. These are the best, rounded, of 1,165 random layouts in which all that
# the minimum scenario needs is in range: the bounds (J'WJ)^-1 are nearest to those that the theory page reports.
_STEP_M, _RADIUS_M = 0.52, 0.70
_CENTRES_XY = np.array([[-1.95, 0.0], [0.0, 0.0], [1.95, 0.0]])
_HEADINGS_RAD = np.array([0.90, -1.41, 2.17])
_LANDMARKS_XY = np.array([[0.41, 1.44], [-0.31, -0.34], [-1.16, -0.97]])
_TURNS_RAD = -np.array([1.04, 0.98, 1.01]) * _STEP_M / _RADIUS_M


@dataclass(frozen=True)
class PaperOptions:
    """One cell of the paper's tables: the scenario, its noise level, and `poses` of each robot (4 or 12 here)."""

    scenario: str = "sufficient"
    poses: int = 4
    sigma_observation: float = 0.1
    sigma_odometry: float = 0.2

    def __post_init__(self) -> None:
        if self.scenario not in SCENARIOS:
            raise InputError(
                f"unknown scenario '{self.scenario}'; choose one of {', '.join(SCENARIOS)}", field="scenario"
            )
        if not 2 <= self.poses <= MAX_INDEX:
            raise InputError(f"a robot can have 2 to {MAX_INDEX:,} poses, found {self.poses:,}", field="poses")
        for name in ("sigma_observation", "sigma_odometry"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"a standard deviation is above zero, found {getattr(self, name)}", field=name)


def simulate_paper(options: PaperOptions, seed: int) -> Dataset:
    """One run of the paper's simulation; the geometry is always the same, the noise is the seed's."""
    sigma = options.sigma_observation
    mast = Sensor("point", sigma_m=sigma, range_m=RANGE_M, mount_xyz_m=(0.0, 0.0, SENSOR_HEIGHT_M))
    bumper = Sensor("relative_pose", sigma_m=sigma, sigma_rad=sigma, range_m=RANGE_M)
    robot = Robot(Odometry(options.sigma_odometry, options.sigma_odometry), mast, bumper)
    world = paper_world(options.poses)
    dataset = observe(world, dict.fromkeys(world.ways, robot), seed)
    return thin(dataset) if options.scenario == "minimum" else dataset


def paper_world(poses: int) -> World:
    """Three robots side by side, each going round on a circle, all clockwise."""
    rim = _RADIUS_M * np.stack([-np.sin(_HEADINGS_RAD), np.cos(_HEADINGS_RAD)], -1)
    start = np.concatenate([_CENTRES_XY + rim, _HEADINGS_RAD[:, None]], -1)
    steps = (3, poses - 1)
    tracks = drive(start, np.full(steps, _STEP_M), np.broadcast_to(_TURNS_RAD[:, None], steps))
    height = np.full((len(_LANDMARKS_XY), 1), LANDMARK_HEIGHT_M)
    landmarks = Pose(np.tile(np.eye(3), (len(_LANDMARKS_XY), 1, 1)), np.concatenate([_LANDMARKS_XY, height], -1))
    return World({robot: Pose.from_xytheta(track) for robot, track in enumerate(tracks, start=1)}, landmarks)


def thin(dataset: Dataset) -> Dataset:
    """The minimum scenario: what is left of a log by the rule above."""
    tables = [t.select(_KEPT[t.source](t)) for t in dataset.tables]
    return dataset.with_tables(t for t in tables if len(t))


def _first_and_last(table: Table) -> BoolArray:
    keep = np.zeros(len(table), bool)
    for landmark in np.unique(table.keys[:, 1]):
        rows = np.flatnonzero(table.keys[:, 1] == landmark)
        keep[rows[[0, -1]]] = True
    return keep


def _one_meeting(table: Table) -> BoolArray:
    """Of robot n's sightings of robot n + 1, the one in the middle of its log."""
    keep = np.zeros(len(table), bool)
    rows = np.flatnonzero(robot_of(table.keys[:, 1]) == table.robot + 1)
    keep[rows[len(rows) // 2 : len(rows) // 2 + 1]] = True
    return keep


_KEPT: dict[str, Callable[[Table], BoolArray]] = {
    "odometry": lambda table: np.ones(len(table), bool),
    "landmarks": _first_and_last,
    "robots": _one_meeting,
}
