"""Every cause of misfit that can be named, planted on one robot and on all, in the plane, between and in space."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

import faults
from teamslam.errors import SolveError
from teamslam.joining import build, join, split
from teamslam.joining.build.build import CURE
from teamslam.model import Dataset, Loss, Table
from teamslam.pipeline import run
from teamslam.sim import PRESETS, Options, simulate
from teamslam.trust import Verdict, explained, sentence, verdict
from thinned import thinned

SPACES = ("2d", "planar", "3d")
ALL = (1, 2, 3)


@cache
def world(preset: str, seed: int = 3) -> Dataset:
    """A simulated team."""
    return simulate(preset, seed)


def judged(log: Dataset) -> Verdict:
    """The verdict on a log's map, as `teamslam run` makes it."""
    return verdict(log, join([build(piece) for piece in split(log)]))


@dataclass(frozen=True)
class Plant:
    """A fault in the tables of one source, and what is to be said of it: the kind of cause, and words."""

    fault: faults.Fault
    source: str
    kind: str
    words: str


MARKS = "sightings of landmarks: "
PLANTS = {
    "mirrored sightings": Plant(faults.negated_angle, "landmarks", "sign", MARKS + "y has the wrong sign"),
    "turns": Plant(faults.negated_angle, "odometry", "sign", "odometry: turns"),
    "turns in degrees": Plant(faults.degrees, "odometry", "degrees", "odometry: turns are in degrees"),
    "millimetres": Plant(faults.longer(1000.0), "landmarks", "unit", MARKS + "lengths are in millimetres"),
    "feet": Plant(faults.longer(1 / 0.3048), "landmarks", "unit", MARKS + "lengths are in feet"),
    "odometry in feet": Plant(faults.longer(1 / 0.3048), "odometry", "unit", "odometry: lengths are in feet"),
    "axes": Plant(faults.swapped, "landmarks", "axes", "they fit as (y, x"),
    "axes of odometry": Plant(faults.swapped, "odometry", "axes", "odometry: places are in other axes than turns"),
    "inverse": Plant(faults.inverted, "odometry", "direction", "odometry: poses are the wrong way round"),
}  # fmt: skip


@pytest.mark.parametrize(("preset", "name", "robots"), thinned(3, SPACES, [*PLANTS], [(1,), ALL]))
def test_slips_of_tables_are_named(preset: str, name: str, robots: tuple[int, ...]) -> None:
    """The sensor, whose it is, and what is wrong with it; and nobody else is accused."""
    plant = PLANTS[name]
    log = faults.plant(world(preset), plant.fault, source=plant.source, robots=robots)
    found = judged(log)
    assert found.gross
    assert [cause.robots for cause in found.causes] == [robots]
    cause = found.causes[0]
    assert cause.kind == plant.kind and plant.words in cause.sentence
    assert cause.sentence.startswith("robot 1, " if robots == (1,) else "all robots, ")
    assert cause.explains > 0.9


@pytest.mark.parametrize("robots", [(1,), ALL], ids=["one", "all"])
def test_bearings_of_the_wrong_sign_or_in_degrees(robots: tuple[int, ...]) -> None:
    """A lidar; where all robots' bearings are mirrored, only their odometry could tell, or be what is wrong itself."""
    log = world("lidar")
    mirrored = judged(faults.plant(log, faults.negated_angle, source="landmarks", robots=robots))
    assert [(c.kind, c.robots) for c in mirrored.causes] == [("sign", robots)]
    assert "sightings of landmarks: bearings have the wrong sign" in mirrored.causes[0].sentence
    assert ("or all robots, odometry" in mirrored.causes[0].sentence) == (robots == ALL)


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(faults.degrees, id="degrees", marks=pytest.mark.slow),  # a landscape of nothing but pits
        pytest.param(faults.longer(1000.0), id="millimetres"),
    ],
)
def test_a_log_that_can_hardly_be_solved_says_what_it_looks_like(fault: faults.Fault) -> None:
    """The map is refused with the cause; an error says the cause first, and advises nothing that would not help. Which
    of both it is, rounding decides: a map of such a log may lack covariances."""
    log = faults.plant(world("lidar"), fault, source="landmarks")
    looks = r"all robots, sightings of landmarks: (angles|lengths) are in"
    said = str(explained(SolveError(f"a submap did not converge.{CURE}"), log))
    assert re.match(f"the log looks like this: {looks}", said)
    assert "As it is: a submap did not converge." in said and CURE not in said
    try:
        found = run(log).verdict
    except SolveError as error:
        assert re.match(f"the log looks like this: {looks}", str(error))
    else:
        assert found.gross and [cause for cause in found.causes if re.match(looks, cause.sentence)]


@pytest.mark.parametrize(("preset", "robots", "steps"), thinned(2, SPACES, [(1,), ALL], [1, -1]))
def test_sightings_by_another_clock(preset: str, robots: tuple[int, ...], steps: int) -> None:
    """One pose later or earlier, which is a second, found to a tenth."""
    log = world(preset)
    found = judged(faults.plant(log, faults.late(log, steps), source="landmarks", robots=robots))
    assert [(c.kind, c.robots) for c in found.causes] == [("clock", robots)]
    said = found.causes[0].sentence
    assert ("late" if steps > 0 else "early") in said
    amounts = [float(word) for word in said.split(" s ")[0].split() if word.replace(".", "").isdigit()]
    assert all(abs(amount - 1.0) < 0.1 for amount in amounts[-2 if "to" in said.split(" s ")[0] else -1 :])


@pytest.mark.parametrize(
    ("preset", "name"), thinned(2, [*SPACES, "mixed"], ["turns", "inverse", "millimetres", "axes"])
)
def test_slips_in_sightings_of_robots(preset: str, name: str) -> None:
    """They show only between robots."""
    fault, words = {
        "turns": (faults.negated_angle, "turns"),
        "inverse": (faults.inverted, "the wrong way round"),
        "millimetres": (faults.longer(1000.0), "in millimetres"),
        "axes": (faults.swapped, "(y, x"),
    }[name]
    log = world(preset, 1)
    seers = tuple(sorted({t.robot for t in log.tables if t.source == "robots"}))
    for robots in ((1,), seers):
        found = judged(faults.plant(log, fault, source="robots", robots=robots))
        assert [cause.robots for cause in found.causes] == [robots]
        assert "sightings of robots: " in found.causes[0].sentence and words in found.causes[0].sentence


@pytest.mark.parametrize("preset", SPACES)
def test_a_robot_that_sees_all_in_a_mirror(preset: str) -> None:
    """By itself it is consistent; the team knows better."""
    found = judged(faults.plant(world(preset, 1), faults.mirrored, robots=(2,)))
    assert [(c.kind, c.robots) for c in found.causes] == [("sign", (2,))]
    assert "robot 2: all is mirrored" in found.causes[0].sentence


@pytest.mark.parametrize("preset", SPACES)
def test_a_robot_that_measures_all_in_another_unit(preset: str) -> None:
    """Noise and all."""

    def fault(table: Table) -> Table:
        scale = np.where(np.arange(table.whitening.shape[-1]) < table.dim, 1e-3, 1.0)
        return replace(faults.longer(1000.0)(table), whitening=table.whitening * scale)

    found = judged(faults.plant(world(preset, 1), fault, robots=(2,)))
    assert [(c.kind, c.robots) for c in found.causes] == [("unit", (2,))]
    assert "robot 2: all lengths are in millimetres" in found.causes[0].sentence


@pytest.mark.parametrize("ticks", [1_000_000, -1_000_000, 5_000_000])
@pytest.mark.parametrize("preset", SPACES)
def test_a_robot_whose_clock_is_off(preset: str, ticks: int) -> None:
    """Seen by others, and seeing them, at other moments than it says; by how much is told, also where that is several
    steps between poses (of 1 s)."""
    log = faults.clock_ahead(world(preset, 1), 2, ticks)
    found = judged(log)
    assert [(c.kind, c.robots) for c in found.causes] == [("clock", (2,))]
    said = re.search(r"clock is ([\d.]+) s (ahead of|behind) those of the others", found.causes[0].sentence)
    assert said and float(said[1]) == pytest.approx(1e-6 * abs(ticks), rel=0.05)
    assert said[2] == ("ahead of" if ticks > 0 else "behind")


@pytest.mark.parametrize("preset", [*SPACES, "lidar"])
def test_a_landmark_in_two_places(preset: str) -> None:
    """Of one robot, or from some moment on; by whom or when, and how far: a metre."""
    log = world(preset)
    tables = [t for t in log.tables if t.source == "landmarks"]
    mark = int(np.argmax(np.bincount(np.concatenate([t.keys[:, -1] for t in tables]))))
    by = np.array([0.8, 0.6, 0.0])[: tables[0].dim]
    seers = [t.robot for t in tables if np.sum(t.keys[:, -1] == mark) > 15]
    other = judged(faults.landmark_moved(log, mark, by, (seers[0],)))
    assert [c.kind for c in other.causes] == ["landmark"]
    words = other.causes[0].sentence.split()
    assert f"sees landmark {mark} " in other.causes[0].sentence
    assert float(words[words.index("m") - 1]) == pytest.approx(1.0, abs=0.1)
    moved = judged(faults.landmark_moved(log, mark, by, ALL, after=0.5))
    assert [c.kind for c in moved.causes] == ["landmark"]
    assert f"landmark {mark} " in moved.causes[0].sentence


@pytest.mark.parametrize("robots", [(1,), ALL], ids=["one", "all"])
@pytest.mark.parametrize("preset", [*SPACES, "lidar"])
def test_a_sigma_that_is_too_small_is_no_mistake(preset: str, robots: tuple[int, ...]) -> None:
    """It is named as what it is, by how much."""
    found = judged(faults.plant(world(preset), faults.surer(2.0), source="landmarks", robots=robots))
    assert found.level == "strained"
    assert [(c.kind, c.robots) for c in found.causes] == [("sigma", robots)]
    assert "times too small" in found.causes[0].sentence and found.causes[0].explains > 0.8


def spoilt(preset: str, seed: int, share: float) -> Dataset:
    """A team whose sightings hold a share of outliers."""
    options = PRESETS[preset]
    assert isinstance(options, Options)
    team = tuple(
        replace(kind, **{n: (s := getattr(kind, n)) and replace(s, outliers=share) for n in ("landmarks", "robots")})
        for kind in options.team
    )
    return simulate(replace(options, team=team), seed)


def drifting(log: Dataset, seed: int) -> Dataset:
    """Sightings with errors that are correlated in time."""
    rng = np.random.default_rng(seed)

    def fault(table):
        noise = rng.normal(size=(len(table), table.whitening.shape[-1]))
        for row in range(1, len(noise)):
            noise[row] = 0.98 * noise[row - 1] + 0.2 * noise[row]
        values = table.values + (1.5 * noise / np.abs(np.diagonal(table.whitening[0])))[:, : table.values.shape[1]]
        return replace(table, values=values)

    return faults.plant(log, fault, source="landmarks")


INNOCENT: dict[str, Callable[[str, int], Dataset]] = {
    "right": lambda preset, seed: simulate(preset, seed),
    "5 % outliers": lambda preset, seed: spoilt(preset, seed, 0.05),
    "sigmas too small": lambda preset, seed: faults.plant(simulate(preset, seed), faults.surer(2.5)),
    "odometry too sure": lambda preset, seed: faults.plant(
        simulate(preset, seed), faults.surer(3.0), source="odometry"
    ),
    "drifting errors": lambda preset, seed: drifting(simulate(preset, seed), seed),
}


@pytest.mark.parametrize(("name", "loss"), thinned(2, [*INNOCENT], [Loss(), Loss("cauchy", 2.0)]))
def test_no_mistake_is_found_where_none_was_made(name: str, loss: Loss) -> None:
    """Noise of every bad kind: no sign, unit, axis, clock or landmark is blamed."""
    for number, preset in enumerate(("2d", "planar", "3d", "mixed", "2d", "planar")):
        log = INNOCENT[name](preset, 50 + number).with_loss(loss)
        found = judged(log)
        assert not [cause.sentence for cause in found.causes if cause.is_mistake], (preset, number)
        if name == "right":
            assert found.level == "fits" and not found.causes


def test_outliers_are_named_with_their_cure() -> None:
    """Under the squared loss they are a gross misfit, under a robust one a few rows."""
    log = spoilt("2d", 7, 0.05)
    squared = judged(log)
    assert squared.gross and [c.kind for c in squared.causes][:1] == ["outliers"]
    assert "a robust loss forgives them" in squared.causes[0].sentence
    robust = judged(log.with_loss(Loss("cauchy", 1.0)))
    assert not robust.gross and "are outliers in" in sentence(robust)
