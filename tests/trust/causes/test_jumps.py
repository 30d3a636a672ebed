"""A step of odometry that jumped is named, and the map is that of the log without it; nobody else's step is."""

from dataclasses import replace

import numpy as np
import pytest

import faults
from teamslam.config import Config
from teamslam.joining import build, join, split
from teamslam.model import SQUARED, Dataset
from teamslam.pipeline import Result, run
from teamslam.sim import faults as plants
from teamslam.sim import simulate
from teamslam.trust.causes.cut import Cut
from teamslam.trust.causes.jumps import jumps
from thinned import thinned

ASKED = {
    "reject": Config(trust=replace(Config().trust, reject=True)),
    "full": Config(method="full"),
    "exact": Config(join=replace(Config().join, exact=True)),
}
PLANTS = [(preset, seed, size) for preset in ("2d", "planar", "3d") for seed in (3, 4, 5) for size in (20.0, 1000.0)]


def cuts_in(log: Dataset) -> list[Cut]:
    """What is found in a log at its map."""
    found = join([build(piece) for piece in split(log)])
    return [cause.mend for c in found.components for cause in jumps(log, c.map) if isinstance(cause.mend, Cut)]


def drawn(log: Dataset, seed: int, count: int = 1) -> list[tuple[int, int]]:
    """Robots and rows of their odometry, not near the ends; of one robot far from each other."""
    rng = np.random.default_rng([seed, 3])
    tables = [t for t in log.tables if t.source == "odometry"]
    which = rng.permutation(len(tables))[:count]
    return [(tables[n].robot, int(rng.integers(len(tables[n]) // 5, 4 * len(tables[n]) // 5))) for n in which]


def without(log: Dataset, cut: tuple[int, int]) -> Dataset:
    robot, row = cut
    rows = [np.arange(len(t)) != row if (t.robot, t.source) == (robot, "odometry") else np.ones(len(t), bool)
            for t in log.tables]  # fmt: skip
    return log.with_tables(t.select(mask) for t, mask in zip(log.tables, rows, strict=True))


def same_map(one: Result, other: Result) -> bool:
    """Whether two results are one map to rounding."""
    mine, theirs = one.map.values, other.map.values
    there = mine.only(theirs.layout.keys)
    return len(mine) == len(theirs) and bool(np.allclose(there.state, theirs.state, atol=1e-6))


@pytest.mark.parametrize("plant", thinned(6, PLANTS))
def test_a_step_that_jumped_is_left_out_and_named(plant: tuple[str, int, float]) -> None:
    """Of 20 sigmas or of 1000: the map is that of the log without this row, no sighting is blamed, and it is told."""
    preset, seed, size = plant
    log = simulate(preset, seed)
    ((robot, row),) = drawn(log, seed)
    result = run(faults.jumped(log, robot, row, size, seed))
    (lost,) = result.joined.left_out
    assert lost.count == 1 and log.names.robot(robot) in lost.what and "the log is cut there" in lost.reason
    assert result.verdict.level in ("fits", "loose") and not result.apart
    assert result.trust.wrong is None or not result.trust.wrong.decisions
    assert same_map(result, run(without(log, (robot, row))))


def test_several_jumps_are_each_named() -> None:
    """Of three robots one each: all are found, and nothing else."""
    log = simulate("2d", 8)
    planted = drawn(log, 8, 3)
    for robot, row in planted:
        log = faults.jumped(log, robot, row, 300.0, row)
    assert {(cut.robot, int(cut.steps[0])) for cut in cuts_in(log)} == set(planted)


@pytest.mark.parametrize("preset", thinned(3, ["2d", "planar", "3d", "lidar", "tags", "mixed"]))
def test_an_honest_team_has_none(preset: str) -> None:
    """Nor has one whose noise of odometry is five times what is stated: its steps are all off alike."""
    log = simulate(preset, 6)
    assert cuts_in(log) == []
    sure = [replace(t, whitening=5.0 * t.whitening) if t.source == "odometry" else t for t in log.tables]
    assert cuts_in(log.with_tables(sure)) == []


@pytest.mark.parametrize("preset", ["2d", "3d"])
def test_wrong_sightings_are_no_jumps(preset: str) -> None:
    """A tenth of all sightings is of another landmark: no step is blamed for them, and one that jumped is found."""
    log = simulate(preset, 7)
    log = log.with_tables(t.with_loss(SQUARED) for t in plants.aliased(log, 0.1, 0.0, 7)[0].tables)
    assert cuts_in(log) == []
    ((robot, row),) = drawn(log, 7)
    (cut,) = cuts_in(faults.jumped(log, robot, row, 1000.0, 7))
    assert cut.robot == robot and row in cut.steps


def test_a_landmark_that_was_moved_is_no_jump() -> None:
    """Two robots have it elsewhere: one landmark is fewer faults than a step of each."""
    log = simulate("2d", 9)
    robots = tuple(sorted(log.robots))[:2]
    seen = [set(t.keys[:, 1].tolist()) for t in log.tables if t.source == "landmarks"]
    mark = min(set.intersection(*seen) or seen[0])
    assert cuts_in(plants.moved(log, robots, mark, np.array([2.0, 1.0]))) == []


@pytest.mark.parametrize("option", ["reject", "full", "exact"])
def test_however_it_is_mapped_right_sightings_stay(option: str) -> None:
    """With --reject no sighting is thrown out for the step; full least squares and exact joins look as well."""
    log = simulate("2d", 3)
    ((robot, row),) = drawn(log, 3)
    result = run(faults.jumped(log, robot, row, 500.0, 3), ASKED[option])
    (lost,) = result.joined.left_out
    assert lost.count == 1 and log.names.robot(robot) in lost.what
    assert result.decisions is None or result.decisions.rejected <= 2


@pytest.mark.parametrize("size", [20.0, 40.0])
def test_a_step_within_the_noise_that_was_stated_is_no_mistake(size: float) -> None:
    """Noise that is stated a hundred times too large, as of many pose graphs: the data put it right, and a step in its
    tail by these makes no log wrong. Of the same log with its noise as it is, the step is named."""
    log = simulate("2d", 3)
    ((robot, row),) = drawn(log, 3)
    jumped = faults.jumped(log, robot, row, size, 3)
    loose = jumped.with_tables(replace(table, whitening=table.whitening / 100.0) for table in jumped.tables)
    assert cuts_in(jumped)
    result = run(loose)
    assert result.calibration and all(scale.scale < 0.1 for scale in result.calibration.scales)
    assert not result.verdict.gross and not result.verdict.mistakes and not result.joined.left_out
