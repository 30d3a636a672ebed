"""The native filter is what its formulas say, for every sensor, loss, kind of variable and robot."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import filtered
from sightings import MARKS, OBSERVERS, OTHERS, SETTINGS, Setting, every_table, table_of, world
from teamslam.errors import ModelError
from teamslam.model import LOSSES, MODELS, Loss, Model, Table, Values
from teamslam.robot import Filter
from teamslam.robot.ahead import Ahead
from teamslam.robot.order import Order
from teamslam.solver import told

SEEDS = st.integers(0, 10_000)


def filter_of(rng: np.random.Generator, setting: Setting, values: Values, know: float) -> Filter:
    """A robot at the first pose that holds the one where it began, another robot's poses and landmarks, some of which
    turn with it: off the truth by as much as it says (`know` of a metre or radian)."""
    keys = np.concatenate([OBSERVERS[:2], OTHERS, MARKS])
    kinds = np.array([*[int(setting.robot)] * 6, *[int(setting.landmark)] * 4])
    turns = np.r_[True, False, rng.random(8) < 0.5]
    order = Order(keys, kinds, turns)
    state, centre = (
        np.concatenate([values.only(np.array([key])).state for key in keys]),
        rng.normal(size=setting.robot.dim),
    )
    root = know * rng.normal(size=(int(order.unknowns[-1]),) * 2) / np.sqrt(order.unknowns[-1])
    there = filtered.retract(order, state, root @ rng.normal(size=len(root)), centre)
    return Filter(int(keys[0]), order, there, root @ root.T, centre)


def close(found: Filter | None, expected: tuple[np.ndarray, np.ndarray], scale: float) -> None:
    """To rounding, which goes with how much more was known afterwards."""
    assert found is not None
    state, covariance = expected
    np.testing.assert_allclose(found.state, state, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.covariance, covariance, rtol=0, atol=1e-10 * scale)
    assert (found.covariance == found.covariance.T).all()


def from_here(rng: np.random.Generator, setting: Setting, values: Values) -> list[Table]:
    """Tables of every sensor from the first pose."""
    tables = []
    for table in every_table(rng, values, setting):
        targets = table.keys[:, -1]
        pairs = targets[:, None] if table.row.unary else np.stack([np.full(len(targets), OBSERVERS[0]), targets], -1)
        again = np.concatenate([pairs, pairs[:1]])  # what is seen twice counts twice
        tables.append(table_of(rng, table.model, table.dim, again, values, table.sensor))
    return tables


@settings(max_examples=10, deadline=None)
@given(setting=st.sampled_from(SETTINGS), seed=SEEDS, loss=st.sampled_from(sorted(LOSSES)))
def test_what_is_seen(setting: Setting, seed: int, loss: str) -> None:
    rng = np.random.default_rng(seed)
    values = world(rng, setting)
    for know in (1e-2, 0.3):
        filter_ = filter_of(rng, setting, values, know)
        for table in from_here(rng, setting, values):
            if not table.row.unary:
                given_ = table.with_loss(Loss(loss, 1.5))
                close(filter_.seen(given_), filtered.seen(filter_, given_), max(know**2, 1.0))


@settings(max_examples=10, deadline=None)
@given(setting=st.sampled_from(SETTINGS), seed=SEEDS, rows=st.integers(1, 3), back=st.booleans())
def test_where_it_moves(setting: Setting, seed: int, rows: int, back: bool) -> None:
    rng = np.random.default_rng(seed)
    values = world(rng, setting)
    filter_ = filter_of(rng, setting, values, 0.1)
    pairs = np.tile(OBSERVERS[[0, 2]][:: -1 if back else 1], (rows, 1))
    table = table_of(rng, "relative_pose", setting.robot.dim, pairs, values)
    start = values.pose(int(OBSERVERS[0])).between(values.pose(int(OBSERVERS[2])))
    found = filter_.moved(table)
    close(found, filtered.moved(filter_, table, filter_.pose @ start), 1.0)
    assert found is not None and found.key == OBSERVERS[2]
    np.testing.assert_allclose(found.pose_covariance, filtered.pose_covariance(found), atol=1e-15)


@settings(max_examples=20, deadline=None)
@given(setting=st.sampled_from(SETTINGS), seed=SEEDS, framed=st.booleans())
def test_what_it_is_told(setting: Setting, seed: int, framed: bool) -> None:
    """Of a map that has others and more, in another order; `framed`: in the frame of the pose where the filter
    began."""
    rng = np.random.default_rng(seed)
    values = world(rng, setting)
    filter_ = filter_of(rng, setting, values, 0.1)
    mine = np.flatnonzero(~filter_.order.turns)
    unknown = np.flatnonzero(filter_.order.turns)[1:]
    places = np.concatenate([mine[:1], rng.permutation(np.concatenate([mine[1:], unknown]))])
    order = filter_.order.only(places)
    order = Order(order.keys, order.kinds, np.zeros(len(places), bool))
    root = 0.1 * rng.normal(size=(int(order.unknowns[-1]),) * 2)
    if framed:
        root[: int(order.unknowns[1])] = 0.0
    state = filtered.retract(
        order, filter_.state[filter_.order.rows(places)], 0.1 * rng.normal(size=len(root)), np.zeros(2)
    )
    ahead = Ahead(int(order.keys[0]), order, state, root @ root.T)
    theirs = np.array([places.tolist().index(place) for place in mine])
    fresh = rng.permutation(np.setdiff1d(np.arange(len(places)), theirs))
    found = told(filter_._numbers, ahead.numbers, theirs, fresh)
    assert found is not None
    for mine_, expected in zip(found, filtered.told(filter_, ahead, theirs, fresh), strict=True):
        np.testing.assert_allclose(mine_, expected, rtol=1e-7, atol=1e-7 * max(1.0, np.abs(expected).max()))
    assert (found[1] == found[1].T).all()


def test_what_is_told_is_checked() -> None:
    rng = np.random.default_rng(6)
    filter_ = filter_of(rng, SETTINGS[0], world(rng, SETTINGS[0]), 0.1)
    mine = np.flatnonzero(~filter_.order.turns)
    with pytest.raises(ModelError, match="fresh: found places 99 to 99, expected 0 to 9"):
        told(filter_._numbers, filter_._numbers, mine, np.array([99]))
    with pytest.raises(ModelError, match="theirs: found shape"):
        told(filter_._numbers, filter_._numbers, mine[:0], np.array([3]))


@pytest.mark.parametrize("setting", SETTINGS[:3])
def test_sensors_that_people_added_give_the_same(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their derivatives are by differences."""
    for name in ("point", "relative_pose"):
        built_in = MODELS[name]
        own = Model(built_in.predict, built_in.minus, built_in.size, built_in.rows, targets_pose=built_in.targets_pose)
        monkeypatch.setitem(MODELS, f"own {name}", own)
    rng = np.random.default_rng(3)
    values = world(rng, setting)
    filter_ = filter_of(rng, setting, values, 0.1)
    pairs = np.stack([np.full(4, OBSERVERS[0]), MARKS], -1)
    table = table_of(rng, "point", setting.dim, pairs, values).with_loss(Loss("huber", 1.5))
    expected = filter_.seen(table)
    found = filter_.seen(replace(table, model="own point"))
    np.testing.assert_allclose(found.state, expected.state, atol=1e-7)
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=1e-7)


def test_what_a_sensor_that_people_added_raises_goes_through(monkeypatch: pytest.MonkeyPatch) -> None:
    built_in = MODELS["point"]

    def broken(*_: object) -> np.ndarray:
        raise ZeroDivisionError("out of range")

    monkeypatch.setitem(MODELS, "own", Model(broken, built_in.minus, built_in.size, built_in.rows))
    rng = np.random.default_rng(4)
    values = world(rng, SETTINGS[0])
    table = table_of(rng, "point", 2, np.stack([np.full(4, OBSERVERS[0]), MARKS], -1), values)
    with pytest.raises(ZeroDivisionError, match="out of range"):
        filter_of(rng, SETTINGS[0], values, 0.1).seen(replace(table, model="own"))


def test_rows_that_leave_the_next_pose_open_or_are_not_finite_do_nothing() -> None:
    rng = np.random.default_rng(5)
    setting = SETTINGS[2]
    values = world(rng, setting)
    filter_ = filter_of(rng, setting, values, 0.1)
    table = table_of(rng, "relative_pose", 3, OBSERVERS[None, [0, 2]], values)
    blind = table.whitening.copy()
    blind[:, 4] = 0.0
    assert filter_.moved(replace(table, whitening=blind)) is None
    far = replace(filter_, state=np.where(np.arange(len(filter_.state)) < 3, 1e300, filter_.state))
    marks = table_of(rng, "range", 3, np.stack([np.full(4, OBSERVERS[0]), MARKS], -1), values)
    assert far.seen(marks) is far
