"""Teams of hundreds of poses a robot, as the simulator makes them: honest noise, but of sensors that see far or hardly,
often or seldom, and odometry that may lose the heading between two sightings. A start is hard to find there.

`draw_team(seed)` is a pure function, so a seed is a log; `str(team)` tells it in one line.
"""

from dataclasses import dataclass

import numpy as np

from stress.world import numbered
from teamslam.model import Dataset
from teamslam.sim import Options, simulate
from teamslam.sim.motion import PATHS
from teamslam.sim.scenario import SPACES, Robot
from teamslam.sim.sense import Odometry, Sensor

OF_LANDMARKS = {"point": 0.3, "range_bearing": 0.3, "bearing": 0.2, "range": 0.1, "relative_pose": 0.1}
OF_ROBOTS = {"none": 0.3, "relative_pose": 0.3, "bearing": 0.2, "range": 0.2}
HEADINGS = {0.003: "sure", 0.01: "good", 0.03: "poor", 0.06: "lost"}  # [rad] a step
DRIVEN = {"join": 0.4, "full": 0.3, "exact": 0.3}


@dataclass(frozen=True)
class Team:
    """A simulated team; `space`, `noise` and `faults` are what campaigns count by."""

    seed: int
    options: Options
    noise: str
    drive: str

    @property
    def space(self) -> str:
        """The world's."""
        return self.options.space

    @property
    def faults(self) -> tuple[str, ...]:
        """What is seen, and by what."""
        (kind,) = self.options.team
        assert kind.landmarks is not None
        met = kind.robots.model if kind.robots is not None else "nothing"
        return f"landmarks by {kind.landmarks.model}", f"robots by {met}"

    def __str__(self) -> str:
        o, (kind,) = self.options, self.options.team
        assert kind.landmarks is not None
        return (
            f"team {self.seed}: {o.space}, {o.robots} robots x {o.poses} poses by {o.path}, {o.step_m:g} m a step in "
            f"{o.arena.side_m:.0f} m, {o.landmarks} {', '.join(self.faults)}; every {kind.landmarks.every} poses, to "
            f"{kind.landmarks.range_m:.0f} m; heading {self.noise} ({kind.odometry.sigma_rad:g} rad a step)"
        )


def draw_team(seed: int) -> Team:
    """The team of a seed."""
    rng = np.random.default_rng((seed, 7))
    sigma = float(rng.choice(list(HEADINGS)))
    seen = Sensor(
        _one(rng, OF_LANDMARKS),
        sigma_m=0.2,
        sigma_rad=0.05,
        range_m=float(rng.uniform(6.0, 25.0)),
        every=int(rng.choice([1, 3, 10])),
    )
    met = _one(rng, OF_ROBOTS)
    robots = None if met == "none" else Sensor(met, sigma_m=0.2, sigma_rad=0.05, range_m=15.0, every=5)
    options = Options(
        space=str(rng.choice(list(SPACES))),
        robots=int(rng.integers(2, 6)),
        poses=int(np.exp(rng.uniform(*np.log([60, 600])))),
        landmarks=int(rng.integers(10, 60)),
        path=str(rng.choice(list(PATHS))),
        step_m=float(rng.choice([0.2, 0.5, 1.0])),
        side_m=float(rng.uniform(20.0, 120.0)),
        team=(Robot(Odometry(0.03, sigma), seen, robots),),
    )
    return Team(seed, options, HEADINGS[sigma], _one(rng, DRIVEN))


def log_of_team(team: Team) -> Dataset:
    """What the team measures, with its truth."""
    log = simulate(team.options, team.seed)
    return log.with_tables(numbered(t for t in log.tables if len(t)))


def _one(rng: np.random.Generator, weights: dict[str, float]) -> str:
    return str(rng.choice(list(weights), p=list(weights.values())))
