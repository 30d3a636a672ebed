"""Live and offline maps are the same maps: pieces that close while a robot drives are those of `split`, to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arrivals import in_time, shaken
from teamslam import build, split
from teamslam.errors import InputError, ModelError
from teamslam.joining.build.split import apart, cuts, stretches
from teamslam.live import drive
from teamslam.model import Dataset, Names, Table, index_of, pose_key
from teamslam.robot import Options, Robot
from teamslam.wire.messages import canonical
from worlds import WORLDS, team

RULES = [{"poses_per_piece": 4}, {"heading_sigma": 0.05}, {"poses_per_piece": 9, "heading_sigma": 0.07}, {}]


def log_with_gaps(world: str, seed: int, gaps: int, poses: int = 40) -> Dataset:
    """A log of two robots in which some odometry is missing, a loop was closed, and poses are counted."""
    whole = team(world, robots=2, poses=poses, landmarks=8, seed=seed)
    rng = np.random.default_rng(seed)
    tables = []
    for table in whole.tables:
        if table.source == "odometry":
            gone = rng.choice(len(table), gaps, replace=False)
            table = table.select(~np.isin(np.arange(len(table)), gone))
        tables.append(table)
    return replace(whole, tables=tuple(tables), names=Names(tick_s=1.0), truth=None)


def same(live: Dataset, offline: Dataset) -> bool:
    """To the bit."""
    return len(live.tables) == len(offline.tables) and all(
        (a.source, a.model, a.dim, a.loss) == (b.source, b.model, b.dim, b.loss)
        and all(np.array_equal(getattr(a, part), getattr(b, part)) for part in ("keys", "values", "whitening", "ids"))
        for a, b in zip(live.tables, offline.tables, strict=True)
    )


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("horizon", [0.0, 3.0])
def test_it_is_due_when_a_piece_has_come_to_its_end_and_seldom_else(rule: dict[str, float], horizon: float) -> None:
    """To look for one goes with the open rows: it is not done at every step."""
    log = log_with_gaps("2d", 5, gaps=0, poses=120)
    limits = {"poses_per_piece": None, "heading_sigma": None} | rule
    robot, looked, moments = Robot.of(log, 1, Options(**limits, horizon_s=horizon)), 0, 0
    for _, tables in in_time(log, 1):
        robot, moments = robot.step(tables), moments + 1
        closed = robot.close()
        assert robot.due or closed is robot
        looked += robot.due
        robot = closed
    assert (len(robot.closed) > 5 and looked <= 8 * len(robot.closed)) or (not rule and not looked)


@settings(max_examples=30, deadline=None)
@given(
    world=st.sampled_from(WORLDS),
    seed=st.integers(0, 10_000),
    gaps=st.integers(0, 3),
    rule=st.sampled_from(RULES),
    horizon=st.integers(0, 12),
    every=st.integers(1, 7),
)
def test_pieces_are_those_of_split_in_any_order_within_the_horizon(
    world: str, seed: int, gaps: int, rule: dict[str, float], horizon: int, every: int
) -> None:
    log = log_with_gaps(world, seed, gaps)
    limits = {"poses_per_piece": None, "heading_sigma": None} | rule
    robot = Robot.of(log, 1, Options(**limits, horizon_s=float(horizon)))
    for number, row in enumerate(shaken(in_time(log, 1), horizon, np.random.default_rng(seed))):
        robot = robot.step([row])
        if number % every == 0:
            robot = robot.close()
    robot = robot.finish()
    live = [piece for number in range(len(robot.closed)) for piece in robot.pieces(number)]
    offline = split(log.of_robot(1), **rule)
    assert robot.counts.late == 0
    assert robot.counts.taken == sum(len(table) for table in log.of_robot(1).tables)
    assert len(live) == len(offline) and all(map(same, live, offline))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), gaps=st.integers(0, 3), rule=st.sampled_from(RULES), at=st.integers(1, 39))
def test_a_log_may_be_cut_while_it_grows(seed: int, gaps: int, rule: dict[str, float], at: int) -> None:
    log = log_with_gaps("2d", seed, gaps).of_robot(1)
    until = int(pose_key(1, at))
    first = cuts(log, 1, until=until, **rule)
    *done, rest = stretches(log, first)
    since = int(first[-1]) if len(first) else None
    later = cuts(rest, 1, since=since, **rule)
    assert np.array_equal(np.concatenate([first, later]), cuts(log, 1, **rule))
    pieces = [piece for part in [*done, *stretches(rest, later)] for piece in apart(part, 1)]
    assert all(map(same, pieces, split(log, **rule)))


@pytest.mark.parametrize("world", WORLDS)
def test_submaps_are_those_of_build_to_the_bit(world: str) -> None:
    log = team(world, robots=2, poses=60, landmarks=8)
    moments = drive(Robot.of(log, 2, Options(poses_per_piece=15)), (tables for _, tables in in_time(log, 2)))
    live = [submap for moment in moments for submap in moment.submaps]
    offline = [build(piece) for piece in split(log.of_robot(2), poses_per_piece=15)]
    assert [canonical(submap) for submap in live] == [canonical(submap) for submap in offline]


def test_what_comes_too_late_is_dropped_and_counted() -> None:
    log = log_with_gaps("2d", 0, 0)
    moments = in_time(log, 1)
    robot = Robot.of(log, 1, Options(horizon_s=5.0))
    late = moments.pop(10)[1]
    for _, tables in moments:
        robot = robot.step(tables)
    before = robot
    robot = robot.step(late)
    assert robot.counts.late == sum(map(len, late)) and robot.open is before.open
    just_in_time = Robot.of(log, 1, Options(horizon_s=40.0 - 10.0)).step(t for _, tables in moments for t in tables)
    assert just_in_time.step(late).counts.late == 0


@pytest.mark.parametrize("poses_per_piece", [6, 100])
def test_what_is_told_again_is_no_row_too_late_however_long_ago(poses_per_piece: int) -> None:
    """A feed that begins anew tells all once more: what is held is counted as repeated, of closed pieces as of open
    rows, and what is lacked alone as late."""
    moments = in_time(log := team("2d", robots=2, poses=30, landmarks=6), 1)
    missed = moments.pop(12)[1]
    robot = Robot.of(log, 1, Options(poses_per_piece=poses_per_piece))
    for _, tables in moments:
        robot = robot.step(tables).close()
    again = robot.step(t for _, tables in moments for t in tables).step(missed)
    taken = sum(len(t) for _, tables in moments for t in tables)
    counts = again.counts
    assert (counts.taken, counts.repeated, counts.late) == (taken, taken, sum(map(len, missed)))
    assert again.closed == robot.closed and again.open is robot.open and again.twice == robot.twice


def test_a_loop_closure_into_a_closed_piece_makes_a_new_version_of_it() -> None:
    log = log_with_gaps("2d", 3, 0)
    odometry = next(t for t in log.of_robot(1).tables if t.source == "odometry")
    loop = replace(
        odometry, source="loops", keys=pose_key(1, np.array([[2, 35]])), values=odometry.values[:1],
        whitening=odometry.whitening[:1], ids=np.array([0]),
    )  # fmt: skip
    log = log.with_tables([*log.of_robot(1).tables, loop])
    robot = Robot.of(log, 1, Options(poses_per_piece=10))
    for tick, tables in in_time(log, 1):
        robot = robot.step(tables).close()
        if tick == 35:
            robot = robot.step([loop])
    robot = robot.finish()
    assert robot.counts.repeated == 1
    assert [piece.version for piece in robot.closed] == [1, 0, 0, 0]
    live = [piece for number in range(len(robot.closed)) for piece in robot.pieces(number)]
    assert all(map(same, live, split(log, poses_per_piece=10)))


def test_a_robot_is_a_value() -> None:
    log = log_with_gaps("2d", 1, 0)
    moments = in_time(log, 1)
    start = Robot.of(log, 1, Options(poses_per_piece=10))
    one = two = start
    for _, tables in moments:
        one = one.step(tables)
    for _, tables in moments:
        two = two.step(tables)
    assert start.open == () and start.now is None
    assert one.now is not None and two.now is not None
    assert np.array_equal(one.now.covariance, two.now.covariance)


def test_rows_that_no_channel_brings_are_refused_with_what_there_is() -> None:
    log = log_with_gaps("2d", 1, 0)
    table: Table = in_time(log, 1)[0][1][0]
    with pytest.raises(ModelError, match=r"no channel for sonar .* it has: odometry"):
        Robot.of(log, 1).step([replace(table, source="sonar")])


@pytest.mark.parametrize(
    ("wrong", "field"),
    [({"poses_per_piece": 1}, "poses_per_piece"), ({"heading_sigma": 0.0}, "heading_sigma"),
     ({"horizon_s": -1.0}, "horizon_s"), ({"landmarks": 0}, "landmarks")],
)  # fmt: skip
def test_options_that_make_no_sense_are_named(wrong: dict[str, float], field: str) -> None:
    with pytest.raises(InputError) as error:
        Options(**wrong)  # type: ignore[arg-type]
    assert error.value.field == field


def test_stamps_count() -> None:
    """The horizon is in seconds, whatever a tick lasts."""
    log = team("2d", robots=2, poses=10)
    assert log.names.tick_s == 1.0 or int(index_of(log.pose_keys[1][-1])) > 0
    assert Robot.of(replace(log, names=Names(tick_s=1e-6)), 1, Options(horizon_s=0.5)).horizon == 500_000
