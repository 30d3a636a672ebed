"""Simulated teams, and what can be wrong with the model of their data."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from teamslam.geometry import Array
from teamslam.model import Dataset, Table
from teamslam.sim.scenario import Options, Robot, simulate_options
from teamslam.sim.sense import Sensor
from teamslam.trust.calibration.persistence import targets_of
from teamslam.trust.calibration.rows import velocities

Change = Callable[[Table, Array, Array], Table]
SCALE, OFFSET_M, DELAY_S, CORRELATION = 0.03, 0.05, 0.05, 0.9
VEER_RAD, STRAIGHT_RAD = 0.008, 0.001


def team(seed: int, model: str = "range_bearing", space: str = "2d", poses: int = 120) -> Dataset:
    """Three robots among twenty landmarks that see each other now and then; their model is right."""
    kind = Robot(landmarks=Sensor(model), robots=Sensor(model, every=3))
    return simulate_options(Options(space=space, robots=3, poses=poses, landmarks=20, team=(kind,)), seed)


def planted(team: Dataset, change: Change) -> Dataset:
    """The team with tables changed, each given its prediction and its error at the truth."""
    assert team.truth is not None
    return team.with_tables(change(t, t.predict(team.truth), t.residual(team.truth)) for t in team.tables)


def offset(team: Dataset, rng: np.random.Generator) -> tuple[Dataset, dict[int, float]]:
    """Ranges longer by a length of each robot's own."""
    lengths = {robot: float(rng.normal(0.0, OFFSET_M)) for robot in team.robots}

    def change(table: Table, h: Array, e: Array) -> Table:
        if table.source == "odometry":
            return table
        return replace(table, values=table.row.plus(h, e + np.array([lengths[table.robot], 0.0]), table.dim))

    return planted(team, change), lengths


def long_steps(team: Dataset) -> Dataset:
    """Odometry whose steps are too long."""

    def change(table: Table, h: Array, e: Array) -> Table:
        if table.source != "odometry":
            return table
        longer = np.concatenate([SCALE * h[:, : table.dim], np.zeros((len(h), e.shape[1] - table.dim))], -1)
        return replace(table, values=table.row.plus(h, e + longer, table.dim))

    return planted(team, change)


def misstated(team: Dataset, times: float, *, odometry: bool = False) -> Dataset:
    """Sightings, or odometry, whose standard deviations are stated so many times as large as they are."""

    def change(table: Table, h: Array, e: Array) -> Table:
        return replace(table, whitening=table.whitening / times) if (table.source == "odometry") == odometry else table

    return planted(team, change)


def late(team: Dataset, delay_s: float) -> Dataset:
    """Sightings of what was to be seen a moment before their stamps, from where robots were then."""
    truth, names = team.truth, team.names
    assert truth is not None
    before = truth.retract(-delay_s * velocities(truth, truth.layout, names))

    def change(table: Table, h: Array, e: Array) -> Table:
        if table.source == "odometry":
            return table
        return replace(table, values=table.row.plus(table.predict(before), e, table.dim))

    return planted(team, change)


def persistent(team: Dataset, correlation: float) -> Dataset:
    """Sightings whose errors hang together from one second to the next, target by target."""

    def change(table: Table, h: Array, e: Array) -> Table:
        if table.source == "odometry":
            return table
        targets, stamps = targets_of(table), team.names.stamps_s(table.keys[:, 0])
        order, errors = np.lexsort((stamps, targets)), e.copy()
        for before, after in pairwise(order):
            if targets[before] == targets[after]:
                kept = correlation ** (stamps[after] - stamps[before])
                errors[after] = kept * errors[before] + np.sqrt(1.0 - kept**2) * e[after]
        return replace(table, values=table.row.plus(h, errors, table.dim))

    return planted(team, change)


def veering(team: Dataset, rng: np.random.Generator) -> Dataset:
    """Odometry that turns by VEER_RAD a root second more than stated, where every other step is said to turn by next to
    nothing else, as on a straight drive."""

    def change(table: Table, h: Array, e: Array) -> Table:
        if table.source != "odometry":
            return table
        straight = np.arange(len(h)) % 2 == 1
        deviations = np.broadcast_to(1.0 / np.einsum("mii->mi", table.whitening), e.shape).copy()
        deviations[straight, 2] = STRAIGHT_RAD
        lasting = np.diff(team.names.stamps_s(table.keys), axis=1)[:, 0]
        errors = deviations * rng.standard_normal(e.shape)
        errors[:, 2] += VEER_RAD * np.sqrt(lasting) * rng.standard_normal(len(h))
        whitening = np.eye(3) / deviations[:, None, :]
        return replace(table, values=table.row.plus(h, errors, table.dim), whitening=whitening)

    return planted(team, change)


FAULTS: dict[str, Callable[[Dataset, np.random.Generator], Dataset]] = {
    "nothing": lambda log, rng: log,
    "sightings' sigmas stated a third of what they are": lambda log, rng: misstated(log, 1.0 / 3.0),
    "sightings' sigmas stated three times what they are": lambda log, rng: misstated(log, 3.0),
    "odometry's sigmas stated a third of what they are": lambda log, rng: misstated(log, 1.0 / 3.0, odometry=True),
    "errors of sightings with correlation 0.9 at 1 s": lambda log, rng: persistent(log, CORRELATION),
    "range offset of 5 cm deviation, a robot": lambda log, rng: offset(log, rng)[0],
    "sightings 50 ms late": lambda log, rng: late(log, DELAY_S),
    "odometry 3 % too long": lambda log, rng: long_steps(log),
}
"""What can be wrong with a log, by name."""
