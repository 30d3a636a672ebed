"""A team in a made-up world: options in, a Dataset with its truth out.

    world -> each robot's odometry -> its sightings of landmarks -> its sightings of other robots -> Dataset

The same options and seed give the same data, to the bit, on one machine. Every robot and sensor draws from a stream of
its own, so that changing one noise level, or a share of outliers, leaves all other draws as they were.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import IntArray, Pose, concatenate
from teamslam.model import Dataset, Kind, Layout, Names, Table, Values, point_kind, pose_kind
from teamslam.model.keys import MAX_INDEX, MAX_ROBOT
from teamslam.sim.motion import PATHS, Arena
from teamslam.sim.sense import Odometry, Sensor, measure_steps, measure_targets
from teamslam.sim.view import landmarks_in_view, robot_in_view
from teamslam.sim.world import World, scattered_landmarks, ways

SPACES = {"2d": (2, 2), "planar": (2, 3), "3d": (3, 3)}
"""Dimension of the robots, and of the world with its landmarks."""


@dataclass(frozen=True)
class Robot:
    """A kind of robot: its odometry, what sees landmarks, what sees other robots (None: nothing does).

    `dim`: 2 on the ground, 3 in the air; None: as the space has it.
    """

    odometry: Odometry = field(default_factory=Odometry)
    landmarks: Sensor | None = field(default_factory=Sensor)
    robots: Sensor | None = field(default_factory=lambda: Sensor("relative_pose", every=5))
    dim: int | None = None

    def __post_init__(self) -> None:
        if self.dim not in (None, 2, 3):
            raise InputError(f"a robot moves on the ground (2) or in the air (3), found {self.dim}", field="dim")


@dataclass(frozen=True)
class Options:
    """A world of any size.

    `space`: '2d' (all in the plane), 'planar' (robots on the ground, landmarks in space) or '3d'. `poses` of each
    robot, `step_m` and `period_s` apart, along `path` (a row of PATHS), in a square of `side_m` (None: 10 m^2 for each
    landmark), `height_m` high. Robot n is of the kind `team[(n - 1) % len(team)]`. `world_seed` None: the world too
    comes from the seed; a number keeps one world for many draws of noise. Raises InputError for values that make no
    sense.
    """

    space: str = "planar"
    robots: int = 3
    poses: int = 60
    landmarks: int = 30
    path: str = "random_walk"
    step_m: float = 0.4
    period_s: float = 1.0
    side_m: float | None = None
    height_m: float = 2.5
    team: tuple[Robot, ...] = (Robot(),)
    world_seed: int | None = None

    def __post_init__(self) -> None:
        if self.space not in SPACES:
            raise InputError(f"unknown space '{self.space}'; choose one of {', '.join(SPACES)}", field="space")
        if self.path not in PATHS:
            raise InputError(f"unknown path '{self.path}'; choose one of {', '.join(PATHS)}", field="path")
        for name, least, most in (("robots", 1, MAX_ROBOT), ("poses", 2, MAX_INDEX), ("landmarks", 0, MAX_INDEX)):
            if not least <= getattr(self, name) <= most:
                raise InputError(f"{least} to {most:,} can be, found {getattr(self, name):,}", field=name)
        for name in ("step_m", "period_s", "height_m", "side_m"):
            if (found := getattr(self, name)) is not None and not 0.0 < found < np.inf:
                raise InputError(f"a number above zero is needed, found {found}", field=name)
        if self.period_s < 1e-6:
            raise InputError(f"stamps are whole microseconds, found a period of {self.period_s} s", field="period_s")
        if not self.team:
            raise InputError("a team needs at least one kind of robot", field="team")
        if self.space == "2d" and any(kind.dim == 3 for kind in self.team):
            raise InputError("a robot of dimension 3 cannot live in the space '2d'; use '3d'", field="team")

    @property
    def arena(self) -> Arena:
        """The square in which all happens."""
        return Arena(self.side_m or float(np.sqrt(10.0 * max(self.landmarks, 10))), self.height_m)

    def kind_of(self, robot: int) -> Robot:
        """The kind of robot number 1, 2, ..."""
        return self.team[(robot - 1) % len(self.team)]


def simulate_options(options: Options, seed: int) -> Dataset:
    """What a team measures in a world of these options."""
    of_robots, of_world = SPACES[options.space]
    kinds = {robot: options.kind_of(robot) for robot in range(1, options.robots + 1)}
    dims = {robot: kind.dim or of_robots for robot, kind in kinds.items()}
    drawn = [seed if options.world_seed is None else options.world_seed]
    landmarks = scattered_landmarks(options.landmarks, of_world, options.arena, np.random.default_rng([*drawn, 2]))
    way = ways(options.path, dims, options.poses, options.step_m, options.arena, drawn)
    return observe(World(way, landmarks, options.period_s), kinds, seed)


def observe(world: World, kinds: dict[int, Robot], seed: int) -> Dataset:
    """What robots of these kinds measure along their ways in a world, with the truth of all that they saw."""
    truth = _truth(world)
    tables = tuple(t for robot in world.ways for t in _log(world, robot, kinds[robot], truth, seed) if len(t))
    dims = {robot: way.dim for robot, way in world.ways.items()}
    dataset = Dataset(dims, tables, Names(tick_s=1e-6), origin=f"simulation, seed {seed}")
    return replace(dataset, truth=_of_kinds(truth, dataset.layout))


def _log(world: World, robot: int, kind: Robot, truth: Values, seed: int) -> Iterator[Table]:
    steps, marks, meetings = (np.random.default_rng([seed, 3, robot, purpose]) for purpose in range(3))
    yield measure_steps(robot, world.pose_keys[robot], kind.odometry, truth, steps)
    if kind.landmarks is not None:
        yield _see_landmarks(world, robot, kind.landmarks, truth, marks)
    if kind.robots is not None:
        yield from _see_robots(world, robot, kind.robots, truth, meetings)


def _see_landmarks(world: World, robot: int, sensor: Sensor, truth: Values, rng: np.random.Generator) -> Table:
    eyes = sensor.eyes(world.ways[robot], world.dim)[:: sensor.every]
    at, seen = landmarks_in_view(eyes, world.landmarks.translation, sensor.range_m, sensor.field_of_view_rad)
    keys = np.stack([world.pose_keys[robot][:: sensor.every][at], world.landmark_keys[seen]], -1)
    return measure_targets(robot, "landmarks", sensor, world.dim, keys, truth, rng)


def _see_robots(world: World, robot: int, sensor: Sensor, truth: Values, rng: np.random.Generator) -> Iterator[Table]:
    """A table for each dimension in which others are seen; their rows are numbered through."""
    met: dict[int, list[IntArray]] = {}
    for other in world.ways.keys() - {robot}:
        dim = max(world.ways[robot].dim, world.ways[other].dim)
        met.setdefault(dim, []).append(_meetings(world, robot, other, sensor, dim))
    first = 0
    for dim, pairs in sorted(met.items()):
        keys = np.concatenate(pairs)
        in_order = keys[np.lexsort((keys[:, 1], keys[:, 0]))]
        table = measure_targets(robot, "robots", sensor, dim, in_order, truth, rng)
        yield replace(table, ids=table.ids + first)
        first += len(table)


def _meetings(world: World, robot: int, other: int, sensor: Sensor, dim: int) -> IntArray:
    """Keys (m, 2) of the poses from which a robot has another in view, and of the other's at the same instants."""
    instants = np.arange(0, min(len(world.ways[robot]), len(world.ways[other])), sensor.every)
    eyes = sensor.eyes(world.ways[robot][instants], dim)
    places = world.ways[other][instants].lift(dim).translation
    seen = instants[robot_in_view(eyes, places, sensor.range_m, sensor.field_of_view_rad)]
    return np.stack([world.pose_keys[robot][seen], world.pose_keys[other][seen]], -1)


def _truth(world: World) -> Values:
    """All there is; landmarks as poses."""
    found: dict[Kind, list[tuple[IntArray, Pose]]] = {pose_kind(world.dim): [(world.landmark_keys, world.landmarks)]}
    for robot, way in world.ways.items():
        found.setdefault(pose_kind(way.dim), []).append((world.pose_keys[robot], way))
    return Values.of(
        {k: (np.concatenate([keys for keys, _ in f]), concatenate([poses for _, poses in f])) for k, f in found.items()}
    )


def _of_kinds(truth: Values, layout: Layout) -> Values:
    """The truth of the variables of a layout; landmarks that nobody saw the orientation of are points there."""
    point = point_kind(2 if (layout.kinds == Kind.POINT2).any() else 3)
    marks = layout.keys_of(point)
    points = Values.of({point: (marks, truth.positions(marks, point.dim))})
    return truth.only(layout.keys[~np.isin(layout.keys, marks)]).update(points)
