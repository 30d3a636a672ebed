"""Whether measurements fix all variables is a question to their rank: weights do not answer it, directions that are not
measured do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import generators
from teamslam.model import LOSSES, Dataset, Loss, Table
from teamslam.solver import System
from teamslam.solver.rank import fixes
from worlds import WORLDS, team

worlds = st.sampled_from(WORLDS)


def system_of(log: Dataset) -> System:
    truth = log.truth
    first = truth.layout.keys[truth.layout.keys >= 1 << 51].min()
    return System(truth.layout, tables=log.tables, fixed=np.array([first]), names=log.names)


def blind(table: Table, axis: int) -> Table:
    """It says nothing of one axis."""
    keep = np.eye(table.whitening.shape[-1])
    keep[axis, axis] = 0.0
    return replace(table, whitening=table.whitening @ keep)


@settings(max_examples=30)
@given(generators, worlds)
def test_weights_do_not_answer_it(rng: np.random.Generator, world: str) -> None:
    """Sigmas twelve orders apart, and losses that forgive what is far off, leave it as it is."""
    log = team(world, robots=2, poses=4, landmarks=3, sees=1.0)
    weighed = [
        replace(t, whitening=10.0 ** rng.uniform(-6.0, 6.0, (len(t), 1, 1)) * t.whitening).with_loss(
            Loss(str(rng.choice(list(LOSSES))), 10.0 ** rng.uniform(-6.0, 0.0))
        )
        for t in log.tables
    ]
    assert fixes(system_of(log), log.truth)
    assert fixes(system_of(log.with_tables(weighed)), log.truth)


@settings(max_examples=30)
@given(generators, worlds, st.data())
def test_a_direction_that_is_not_measured_is_open(rng: np.random.Generator, world: str, data: st.DataObject) -> None:
    """A robot that sees and meets nothing, and of whose steps one axis is unknown, has an open axis."""
    log = team(world, robots=2, poses=4, landmarks=3, sees=1.0)
    (odometry,) = (t for t in log.tables if t.robot == 1 and t.source == "odometry")
    axis = data.draw(st.integers(0, odometry.whitening.shape[-1] - 1))
    turned = np.linalg.qr(rng.normal(size=odometry.whitening.shape[-2:]))[0]  # a root of the same information
    parts = [replace(blind(odometry, axis), whitening=turned @ blind(odometry, axis).whitening)]
    alone = replace(log, tables=tuple(parts), truth=log.truth.only(np.unique(odometry.keys)))
    assert not fixes(system_of(alone), alone.truth)
    whole = replace(alone, tables=(odometry,))
    assert fixes(system_of(whole), whole.truth)


@pytest.mark.parametrize("world", WORLDS)
def test_what_nobody_saw_is_open(world: str) -> None:
    log = team(world, robots=1, poses=4, landmarks=2, sees=1.0)
    unseen = log.with_tables(t for t in log.tables if t.source == "odometry")
    assert not fixes(system_of(replace(unseen, truth=log.truth)), log.truth)
