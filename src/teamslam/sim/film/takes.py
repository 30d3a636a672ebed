"""A film: what each robot of a stage recorded, frame by frame, and the truth."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.clock import Clock
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import AnyArray, Array, Pose
from teamslam.model import is_whole
from teamslam.sim.film.clocks import Clocks, drawn_clocks, stamped
from teamslam.sim.film.develop import Sensor, develop
from teamslam.sim.film.ranging import Ranger, ranged
from teamslam.sim.film.render import Renderer
from teamslam.sim.film.shutter import Shutter
from teamslam.sim.film.stage import Stage, experiment

START_TICK = 1_700_000_000 * TICKS_PER_S
KINECT = Camera((525.0, 525.0), (319.5, 239.5), "radtan", (0.05, -0.11, 0.0008, -0.0005, 0.02), (640, 480))
"""Much like a Kinect's colour camera: 63 degrees wide, a little distorted."""


@dataclass(frozen=True)
class Options:
    """How a film is made: how long, images and odometry a second, the camera with its shutter, its sensor and that of
    depth, how much later than the middle of its exposure an image is stamped, whether clocks are off
    (`clocks.drawn_clocks`), how far robots shake where they look about [rad], and the noise of odometry per root of a
    metre, a second and a radian."""

    seconds: float = 60.0
    images_hz: float = 5.0
    odometry_hz: float = 50.0
    camera: Camera = KINECT
    shutter: Shutter = field(default_factory=Shutter)
    sensor: Sensor = field(default_factory=Sensor)
    ranger: Ranger = field(default_factory=Ranger)
    delay_s: float = 0.0
    off_clocks: bool = False
    shakes: float = 0.0
    slip_m: float = 0.01
    drift_m: float = 0.001
    slip_rad: float = 0.015
    drift_rad: float = 0.001

    def __post_init__(self) -> None:
        if not 1.0 <= self.seconds <= 3600.0:
            raise InputError(f"a film lasts 1 s to an hour, found {self.seconds:g} s", field="seconds")
        for name in ("images_hz", "odometry_hz"):
            if not 0.1 <= getattr(self, name) <= 200.0:
                raise InputError(f"0.1 to 200 a second, found {getattr(self, name):g}", field=name)


PRESETS: dict[str, Options] = {
    "experiment": Options(),
    "clocks": Options(off_clocks=True, shakes=0.35, slip_rad=0.004),
    "ideal": Options(
        shutter=Shutter(0.0, 0.0), sensor=Sensor(blur_px=0.4, vignetting=0.0, breathing=0.0, read=0.5, shot=0.0)
    ),
}


@dataclass(frozen=True, eq=False)
class Frame:
    """An image (h, w) of bytes, the depths (h, w) of its pixels [mm], 0 where there is none, and its stamp."""

    tick: int
    image: AnyArray
    depth: AnyArray


@dataclass(frozen=True, eq=False)
class Film:
    """A stage that is filmed: the same options and seed give the same film, to the bit."""

    options: Options
    stage: Stage
    seed: int

    @property
    def robots(self) -> range:
        """Their numbers, from 0."""
        return range(len(self.stage.ways))

    @cached_property
    def stamps_s(self) -> Array:
        """The middle of each exposure [s] after the start; the first is a tenth of a second late, so that there is
        odometry before it."""
        return np.asarray(np.arange(0.1, self.options.seconds - 0.05, 1.0 / self.options.images_hz))

    def frames(self, robot: int) -> Iterator[Frame]:
        """The images of a robot, drawn one by one."""
        for k, t in enumerate(self.stamps_s.tolist()):
            rng = np.random.default_rng([self.seed, 1, robot, k])
            image = develop(self._renderer.image(robot, t), self.options.sensor, t, rng)
            rng = np.random.default_rng([self.seed, 4, robot, k])
            depth = ranged(self._renderer.depth(robot, t), self.options.ranger, rng)
            tick = _ticks(np.array([t + self.options.delay_s + self.clocks.latency(robot)]))
            yield Frame(int(self.clock(robot).own(tick)[0]), image, depth)

    @cached_property
    def clocks(self) -> Clocks:
        """What all clocks are off by."""
        return drawn_clocks(self.seed, len(self.robots)) if self.options.off_clocks else Clocks()

    def clock(self, robot: int) -> Clock:
        """A robot's clock."""
        return self.clocks.of(robot, self._middle)

    @cached_property
    def _middle(self) -> int:
        ticks = _ticks(self._odometry_s)
        return int((ticks[0] + ticks[-1]) // 2)

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(self.stage, self.options.camera, self.options.shutter)

    def truth(self, robot: int) -> Track:
        """Where a robot was, as often as odometry comes, by the clock of the motion capture."""
        t = self._odometry_s
        poses = Pose.from_xytheta(self.stage.ways[robot].at(t))
        capture = Clock(self._middle, self.clocks.capture_s)
        return stamped(Track(_ticks(t), _in_space(poses), "world", f"robot{robot + 1}"), capture)

    def odometry(self, robot: int) -> Track:
        """What a robot's wheels say, from a start of its own."""
        t, rng = self._odometry_s, np.random.default_rng([self.seed, 2, robot])
        way = Pose.from_xytheta(self.stage.ways[robot].at(t))
        steps = way[:-1].between(way[1:]).xytheta()
        dt, o = np.diff(t), self.options
        length, turn = np.linalg.norm(steps[:, :2], axis=1), np.abs(steps[:, 2])
        sigmas = np.sqrt(np.stack([o.drift_m**2 * dt + o.slip_m**2 * length] * 2
                                  + [o.drift_rad**2 * dt + o.slip_rad**2 * turn], -1))  # fmt: skip
        steps = steps + sigmas * rng.normal(size=steps.shape)
        heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
        c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
        moves = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], -1)
        xy = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, 0)])
        poses = Pose.from_xytheta(np.concatenate([xy, heading[:, None]], -1))
        return stamped(Track(_ticks(t), _in_space(poses), "odom", "base"), self.clock(robot))

    @cached_property
    def _odometry_s(self) -> Array:
        return np.asarray(np.arange(0.0, self.options.seconds + 0.05, 1.0 / self.options.odometry_hz))


def film(options: Options, seed: int = 0) -> Film:
    """A film of the paper's experiment, its places, ways and noise drawn by the seed. InputError for a seed below 0."""
    if not is_whole(seed) or seed < 0:
        raise InputError(f"a seed is a whole number from 0 on, found {seed}", field="seed")
    return Film(options, experiment(np.random.default_rng([seed, 0]), options.shakes), seed)


def _ticks(t_s: Array) -> AnyArray:
    return np.asarray(START_TICK + np.round(t_s * TICKS_PER_S).astype(np.int64))


def _in_space(poses: Pose) -> Pose:
    """Poses on the floor, as poses in space."""
    n = len(poses)
    rotation, place = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    rotation[:, :2, :2], place[:, :2] = poses.rotation, poses.translation
    return Pose(rotation, place)
