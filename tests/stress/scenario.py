"""What a log is, before there is one: a world, robots' ways, senses, noise and faults, all drawn from one seed.

`draw(seed)` is a pure function, so a seed is a log; `str(scenario)` tells it in one line.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from stress.faults import FAULTS
from stress.ways import WAYS
from teamslam.model import SQUARED, Loss

T = TypeVar("T")

SPACES = {"2d": 0.35, "planar": 0.25, "3d": 0.25, "mixed": 0.15}
ROBOTS = {1: 0.2, 2: 0.3, 3: 0.22, 4: 0.13, 5: 0.06, 6: 0.04, 8: 0.05}
POSES = {(1, 1): 0.04, (2, 2): 0.08, (3, 6): 0.53, (7, 12): 0.32, (13, 20): 0.03}
CROWD = {(1, 1): 0.1, (2, 2): 0.25, (3, 4): 0.65}  # where there are more than three robots
MIDDLE = {(30, 60): 0.7, (60, 150): 0.3}
LANDMARKS = {(0, 0): 0.15, (1, 1): 0.1, (2, 5): 0.45, (6, 12): 0.3}
# Scales of noise: of lengths [m] and angles [rad], from .. to (drawn evenly in the logarithm, for each sense anew).
NOISES = {
    "fine": (0.5, (1e-3, 1e-1), (1e-3, 5e-2)),
    "coarse": (0.12, (1e-1, 1.0), (3e-2, 0.3)),
    "tiny": (0.1, (1e-6, 1e-4), (1e-6, 1e-4)),
    "mixed": (0.22, (1e-6, 1e2), (1e-6, 1e0)),
    "wild": (0.06, (1e-6, 1e2), (1e-6, 1e2)),
}
OF_LANDMARKS = {"point": 0.25, "range_bearing": 0.25, "bearing": 0.2, "range": 0.15, "relative_pose": 0.15}
OF_ROBOTS = {"relative_pose": 0.4, "range_bearing": 0.2, "range": 0.16, "point": 0.12, "bearing": 0.12}
FORGIVE = 0.5  # of all logs: those in which some senses have a loss that does
LOSSES = {"squared": 0.25, "huber": 0.25, "cauchy": 0.25, "geman_mcclure": 0.25}
MEET = {"next": 0.3, "all": 0.3, "one": 0.1, "never": 0.15, "ranges": 0.15}
WORLD = {"nothing": 0.78, "position": 0.08, "pose": 0.07, "landmarks": 0.07}


@dataclass(frozen=True)
class Robot:
    """A robot of dimension `dim` (2 or 3), its number of poses, and its way (a row of WAYS)."""

    dim: int
    poses: int
    way: str


@dataclass(frozen=True)
class Sense:
    """What a robot measures: `of` odometry, landmarks, robots, world (its own poses there), marks (landmarks there) or
    loops; by which model; what share of all that it could see; with which noise; under which loss."""

    of: str
    model: str
    sees: float
    sigma_m: float
    sigma_rad: float
    loss: Loss = SQUARED
    mounted: bool = False
    correlated: bool = False
    uneven: bool = False

    def __str__(self) -> str:
        parts = [f"{self.of} by {self.model} {self.sees:.2g} @ {self.sigma_m:.1e} m {self.sigma_rad:.1e} rad"]
        parts += [f"{self.loss.name}({self.loss.scale:g})"] if self.loss.name != "squared" else []
        flags = (("mounted", self.mounted), ("correlated", self.correlated), ("uneven", self.uneven))
        return " ".join(parts + [name for name, set_ in flags if set_])


@dataclass(frozen=True)
class Scenario:
    """A log to be. `world` builds it."""

    seed: int
    space: str
    robots: tuple[Robot, ...]
    landmarks: int
    meet: str
    noise: str
    senses: tuple[Sense, ...]
    faults: tuple[str, ...]

    def __str__(self) -> str:
        ways = ", ".join(f"{r.dim}D {r.way} x {r.poses}" for r in self.robots)
        senses = "; ".join(map(str, self.senses))
        faults = ", ".join(self.faults) or "none"
        return (
            f"seed {self.seed}: {self.space}, robots [{ways}], {self.landmarks} landmarks, meet {self.meet}, noise "
            f"{self.noise} | {senses} | faults: {faults}"
        )


def draw(seed: int, *, middle: bool = False) -> Scenario:
    """The scenario of a seed; `middle`: of dozens to some hundred poses instead of a handful."""
    rng = np.random.default_rng((seed, 1 + middle))
    space = _one(rng, SPACES)
    count = _one(rng, ROBOTS)
    dims = {"2d": [2], "planar": [2], "3d": [3], "mixed": [2, 3]}[space]
    lengths = MIDDLE if middle else POSES if count <= 3 else CROWD
    robots = tuple(
        Robot(int(rng.choice(dims)), _between(rng, _one(rng, lengths)), str(rng.choice(list(WAYS))))
        for _ in range(count)
    )
    meet, noise = _one(rng, MEET), _one(rng, {name: row[0] for name, row in NOISES.items()})
    landmarks, forgives = _between(rng, _one(rng, LANDMARKS)), rng.random() < FORGIVE
    senses = [_sense(rng, noise, forgives, "odometry", "relative_pose")]
    for _ in range(int(landmarks > 0) * (1 + (rng.random() < 0.25))):
        senses.append(_sense(rng, noise, forgives, "landmarks", _one(rng, OF_LANDMARKS)))
    if count > 1 and meet != "never":
        for _ in range(1 + (rng.random() < 0.2)):
            model = "range" if meet == "ranges" else _one(rng, OF_ROBOTS)
            senses.append(_sense(rng, noise, forgives, "robots", model))
    if rng.random() < 0.2:
        senses.append(_sense(rng, noise, forgives, "loops", "relative_pose"))
    of_world = _one(rng, WORLD)
    if of_world in ("position", "pose"):
        senses.append(_sense(rng, noise, forgives, "world", of_world))
    elif of_world == "landmarks" and landmarks:
        senses.append(_sense(rng, noise, forgives, "marks", "position"))
    faults = rng.choice(list(FAULTS), size=_one(rng, {0: 0.35, 1: 0.35, 2: 0.2, 3: 0.1}), replace=False)
    if "utm" in faults and of_world == "nothing":
        senses.append(_sense(rng, noise, forgives, "world", "position"))
    return Scenario(seed, space, robots, landmarks, meet, noise, tuple(senses), tuple(map(str, faults)))


def _sense(rng: np.random.Generator, noise: str, forgives: bool, of: str, model: str) -> Sense:
    _, lengths, angles = NOISES[noise]
    robust = 0.1 if of == "odometry" else 1.0
    loss = _one(rng, LOSSES) if forgives and rng.random() < robust else "squared"
    return Sense(
        of,
        model,
        sees=float(rng.choice([1.0, 0.6, 0.3, 0.1])),
        sigma_m=float(np.exp(rng.uniform(*np.log(lengths)))),
        sigma_rad=float(np.exp(rng.uniform(*np.log(angles)))),
        loss=Loss(loss, float(rng.choice([1.0, 2.0, 0.5, 5.0]))),
        mounted=of in ("landmarks", "robots", "world") and rng.random() < 0.25,
        correlated=rng.random() < 0.15,
        uneven=rng.random() < 0.15,
    )


def _one(rng: np.random.Generator, weights: dict[T, float]) -> T:
    shares = np.array(list(weights.values()))
    return list(weights)[int(rng.choice(len(shares), p=shares / shares.sum()))]


def _between(rng: np.random.Generator, ends: tuple[int, int]) -> int:
    return int(rng.integers(ends[0], ends[1] + 1))
