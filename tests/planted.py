"""Logs with a mistake that is known, and logs without one, all drawn from a seed: what is said of them can be counted.

A plant is a world (plane, ground, space), what its robots see by (points, ranges, bearings, poses), the noise and the
loss, and a mistake: in one robot's sensor, in one sensor of all, in a whole robot, in a landmark or in what sigmas say.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

import faults
from teamslam.errors import SolveError
from teamslam.model import Dataset, Loss, Table
from teamslam.pipeline import run
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.sense import Odometry
from teamslam.trust import Cause
from teamslam.trust.causes.search import mistakes_of_robots
from teamslam.trust.causes.told import looks_like

SEES = {"point": 0.3, "range_bearing": 0.35, "bearing": 0.1, "range": 0.1, "relative_pose": 0.15}
MEETS = {"relative_pose": 0.4, "range_bearing": 0.4, "point": 0.2}
TICK = 1_000_000  # of a step between poses
MOVED = {("point", 2), ("point", 3), ("range_bearing", 2)}  # sightings by which a landmark can be moved by hand


@dataclass(frozen=True, eq=False)
class Plant:
    """A log, the name of its mistake ('' for none), whose it is, and the kinds of cause that name it rightly. `free`:
    what is said of it as well and is true too, as where a mirrored eye is a mirrored wheel."""

    log: Dataset
    mistake: str
    robots: tuple[int, ...]
    kinds: tuple[str, ...]
    world: str


def _any(rng: np.random.Generator, shares: dict[str, float]) -> str:
    return str(rng.choice(list(shares), p=np.array(list(shares.values())) / sum(shares.values())))


def world(rng: np.random.Generator, seed: int) -> tuple[Dataset, str]:
    """A simulated team, and what it is in words."""
    space = str(rng.choice(["2d", "planar", "3d"], p=[0.45, 0.3, 0.25]))
    sees, meets = _any(rng, SEES), _any(rng, MEETS)
    fine = float(10.0 ** rng.uniform(-0.5, 0.4))
    team = Robot(
        odometry=Odometry(0.02 * fine, 0.01 * float(10.0 ** rng.uniform(-0.3, 0.3))),
        landmarks=Sensor(sees, sigma_m=0.05 * fine, outliers=float(rng.choice([0.0, 0.0, 0.02]))),
        robots=Sensor(meets, every=int(rng.choice([2, 3, 5]))),
    )
    options = Options(
        space=space,
        robots=int(rng.choice([1, 2, 3, 4], p=[0.15, 0.25, 0.4, 0.2])),
        poses=int(rng.integers(40, 120)),
        landmarks=int(rng.integers(15, 40)),
        team=(team,),
    )
    loss = (Loss(), Loss("huber", 2.0), Loss("cauchy", 2.0))[int(rng.integers(3))]
    return simulate(options, seed).with_loss(
        loss
    ), f"{space} {sees}/{meets} {loss.name} {options.robots}x{options.poses}"


TABLES: dict[str, tuple[Callable[[], faults.Fault], tuple[str, ...]]] = {
    "sign": (lambda: faults.negated_angle, ("sign",)),
    "degrees": (lambda: faults.degrees, ("degrees",)),
    "millimetres": (lambda: faults.longer(1e3), ("unit",)),
    "centimetres": (lambda: faults.longer(1e2), ("unit",)),
    "feet": (lambda: faults.longer(1.0 / 0.3048), ("unit",)),
    "axes": (lambda: faults.swapped, ("axes",)),
    "direction": (lambda: faults.inverted, ("direction",)),
}
HOLDS = {  # which models can hold a mistake at all
    "sign": ("point", "range_bearing", "bearing", "relative_pose"),
    "degrees": ("range_bearing", "bearing"),
    "millimetres": ("point", "range_bearing", "range", "relative_pose"),
    "centimetres": ("point", "range_bearing", "range", "relative_pose"),
    "feet": ("point", "range_bearing", "range", "relative_pose"),
    "axes": ("point", "relative_pose"),
    "direction": ("relative_pose",),
}
OTHERS = ("late", "clock", "two places", "mirrored robot", "sigma 3", "sigma 1/3", "outliers")
MISTAKES = (*TABLES, *OTHERS)


def plant_in(log: Dataset, mistake: str, rng: np.random.Generator, told: str = "") -> Plant | None:
    """A mistake in a log, in a sensor or a robot that is drawn; None where the log has no place for it."""
    robots = tuple(sorted(log.robots))
    who = robots if rng.random() < 0.4 else (int(rng.choice(robots)),)
    if mistake in TABLES:
        fault, kinds = TABLES[mistake]
        held = {t.source for t in log.tables if t.model in HOLDS[mistake] and t.robot in who}
        if mistake == "degrees" and log.robots[robots[0]] == 2:
            held |= {"odometry"}
        if not held or (
            mistake in ("sign", "degrees") and any(t.dim == 3 and t.model == "bearing" for t in log.tables)
        ):
            return None
        source = str(rng.choice(sorted(held)))
        mine = tuple(sorted({t.robot for t in log.tables if t.source == source} & {*who}))
        return Plant(faults.plant(log, fault(), source=source, robots=mine), f"{mistake} {source}", mine, kinds, told)
    if mistake == "late":
        steps = int(rng.choice([-2, -1, 1, 2]))
        return Plant(
            faults.plant(log, faults.late(log, steps), source="landmarks", robots=who), mistake, who, ("clock",), told
        )
    if mistake == "clock":
        linked = sorted({t.robot for t in log.tables if t.observes_robots})
        if len(robots) < 2 or not linked:
            return None
        one = int(rng.choice(linked))
        return Plant(
            faults.clock_ahead(log, one, int(rng.choice([-2, -1, 1, 2])) * TICK), mistake, (one,), ("clock",), told
        )
    if mistake == "two places":
        return _two_places(log, rng, told)
    if mistake == "mirrored robot":
        if len(robots) < 2 or any(t.model == "range" or (t.dim == 3 and t.model == "bearing") for t in log.tables):
            return None
        one = int(rng.choice(robots))
        return (
            Plant(faults.plant(log, faults.mirrored, robots=(one,)), mistake, (one,), ("sign",), told)
            if _all_of(log, one)
            else None
        )
    if mistake.startswith("sigma"):
        factor = 3.0 if mistake == "sigma 3" else 1.0 / 3.0
        kinds = ("sigma",) if factor > 1.0 else ()
        return Plant(faults.plant(log, faults.surer(factor), source="landmarks", robots=who), mistake, who, kinds, told)
    return Plant(_spoilt(log, rng, who), mistake, who, ("outliers",), told)


def _all_of(log: Dataset, robot: int) -> bool:
    """Whether something but itself would know a robot that has all in a mirror."""
    marks = [{*np.unique(t.keys[:, -1]).tolist()} for t in log.tables if t.source == "landmarks" and t.robot != robot]
    mine = {
        m for t in log.tables if t.source == "landmarks" and t.robot == robot for m in np.unique(t.keys[:, -1]).tolist()
    }
    return len(mine & set().union(*marks)) > 5


def _two_places(log: Dataset, rng: np.random.Generator, told: str) -> Plant | None:
    seen = [t for t in log.tables if t.source == "landmarks" and (t.model, t.dim) in MOVED]
    if not seen or log.truth is None:
        return None
    marks, counts = np.unique(np.concatenate([t.keys[:, -1] for t in seen]), return_counts=True)
    mark = int(rng.choice(marks[counts >= min(40, counts.max())]))
    of_mark = log.truth.only(np.array([mark])).state
    if len(of_mark) > 3:
        return None
    by = np.zeros(len(of_mark))
    by[:2] = float(rng.uniform(1.0, 2.0)) * np.array([0.8, 0.6])
    there = {t.robot: int(np.sum(t.keys[:, -1] == mark)) for t in seen}
    few = [robot for robot, n in there.items() if n >= 15]
    if len(few) > 1 and rng.random() < 0.5:
        one = (int(rng.choice(few)),)
        return Plant(faults.landmark_moved(log, mark, by, one), "two places", one, ("landmark",), told)
    moved = faults.landmark_moved(log, mark, by, tuple(log.robots), after=0.5)
    return Plant(moved, "two places", tuple(log.robots), ("landmark",), told)


def _spoilt(log: Dataset, rng: np.random.Generator, robots: Sequence[int]) -> Dataset:
    """A tenth of the sightings of landmarks far off."""

    def fault(table: Table) -> Table:
        values, wild = table.values.copy(), rng.random(len(table)) < 0.1
        lengths = {"range": 1, "range_bearing": 1, "bearing": 0}.get(table.model, table.dim)
        values[wild, :lengths] *= rng.uniform(1.3, 3.0, (int(wild.sum()), lengths))
        if table.model in ("bearing", "range_bearing") and table.dim == 2:
            values[wild, -1] += rng.uniform(-2.0, 2.0, int(wild.sum()))
        return replace(table, values=values)

    return faults.plant(log, fault, source="landmarks", robots=tuple(robots))


def draw(seed: int, mistake: str | None = None) -> Plant | None:
    """The plant of a seed: with a mistake that is drawn, or a given one ('' for none); None where its world has no
    place for it."""
    rng = np.random.default_rng([seed, 17])
    log, told = world(rng, seed)
    name = str(rng.choice(MISTAKES)) if mistake is None else mistake
    return plant_in(log, name, rng, told) if name else Plant(log, "", (), (), told)


# --- what is said of it -----------------------------------------------------------------------------------------------

WORDS = {
    "sign": ("wrong sign", "mirror"),
    "degrees": ("in degrees",),
    "millimetres": ("in millimetres",),
    "centimetres": ("in centimetres",),
    "feet": ("in feet",),
    "axes": ("axes", "they fit"),
    "direction": ("wrong way round",),
    "late": ("stamps are",),
    "clock": ("clock is",),
    "two places": ("landmark",),
    "mirrored robot": ("mirror",),
}


def said_by_run(log: Dataset) -> list[Cause]:
    """What a run says that a log looks like, or put right of it, whether it can be solved or not."""
    try:
        result = run(log)
        return [*result.apart, *result.verdict.causes]
    except SolveError:
        return mistakes_of_robots(log, log.robots)


def said_by_info(log: Dataset) -> list[Cause]:
    """What is said before anything is solved."""
    return list(looks_like(log))


def outcome(plant: Plant, causes: Sequence[Cause]) -> str:
    """'right', 'silent' or 'false': whether the mistake is named and nothing else, of its robots and nobody else."""
    mistakes = [cause for cause in causes if cause.is_mistake]
    name = next((known for known in WORDS if plant.mistake.startswith(known)), "")
    if not name:
        noise = [cause for cause in causes if cause.kind in plant.kinds and {*cause.robots} & {*plant.robots}]
        return "false" if mistakes else "right" if noise or not plant.kinds else "silent"
    right = [
        c
        for c in mistakes
        if any(word in c.sentence for word in WORDS[name]) and ({*c.robots} <= {*plant.robots} or _either(plant, c))
    ]
    return "false" if len(right) < len(mistakes) else "right" if right else "silent"


def _either(plant: Plant, cause: Cause) -> bool:
    """Whether a cause is said to be one robot's or the other's, of two of which nobody can know: whose clock is off."""
    both = {*plant.log.robots}
    return cause.kind == "clock" and len(both) == 2 and {*cause.robots} == both and ", or robot " in cause.sentence
