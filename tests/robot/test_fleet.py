"""A team that drives and exchanges: every robot ends up with the offline map, to the bit, whatever the links do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.fleet import Fleet, fleet
from teamslam.joining import build, join, split
from teamslam.live import built, mapped, replayed, start_of
from teamslam.model import Dataset, Sources
from teamslam.results.fleet import bits_of, joined, links_of, report_of
from teamslam.robot import Atlas, Options, Robot
from teamslam.robot.link.memory import Weather
from teamslam.robot.peer import Habits
from teamslam.solver import Covariances
from teamslam.team import SubmapSet
from worlds import team

PIECES = Options(poses_per_piece=12)


def maps_of(found: Fleet) -> set[bytes]:
    return {bits_of(joined(member.peer.held)) for member in found.members.values()}


def offline(log: Dataset) -> bytes:
    return bits_of(joined(SubmapSet.of(*(build(piece) for piece in split(log, poses_per_piece=12)))))


@settings(max_examples=6, deadline=None)
@given(
    seed=st.integers(0, 1000),
    loss=st.floats(0.0, 0.5),
    twice=st.floats(0.0, 0.5),
    most_s=st.floats(0.0, 5.0),
    rate=st.sampled_from([None, 20_000.0]),
)
def test_every_robot_ends_up_with_the_offline_map(
    seed: int, loss: float, twice: float, most_s: float, rate: float | None
) -> None:
    log = team("2d", robots=3, poses=30, landmarks=8, sees=0.5)
    weather = Weather(loss, twice, 0.0, most_s, rate)
    found = fleet(log, PIECES, weather=weather, habits=Habits(rate=rate), seed=seed)
    assert found.settled_s is not None and maps_of(found) == {offline(log)}
    for link in links_of(found, log.names):  # the ledger says what went over the wire
        assert link["body_bytes"] + link["word_bytes"] == link["carried_bytes"]


def test_the_record_says_what_came_of_it() -> None:
    log = team("planar", robots=2, poses=30, landmarks=8, sees=0.6)
    record, made = report_of(log, fleet(log, PIECES), PIECES)
    assert record["maps_equal"] and record["equal_to_offline"] and record["components"] == 1
    assert made is not None and record["robot_position_rmse_m"] < 0.1
    assert record["online_position_rmse_m"] < 0.3
    assert set(record["alone"]) == {"1", "2"}
    for number in (1, 2):  # what it comes to where nobody is heard of
        single = log.of_robot(number)
        found, _ = report_of(single, fleet(single, PIECES), PIECES)
        same = {name: found[name] for name in ("robot_position_rmse_m", "landmark_rmse_m", "online_position_rmse_m")}
        assert record["alone"][str(number)] == same and same["online_position_rmse_m"] > 0.0
    assert all(not robot["missing"] and not robot["refused"] for robot in record["robots"].values())


def test_robots_that_cannot_talk_say_so() -> None:
    log = team("2d", robots=2, poses=20, landmarks=6)
    found = fleet(log, PIECES, weather=Weather(loss=0.999999), settle_s=20.0)
    record, _ = report_of(log, found, PIECES)
    assert found.settled_s is None and not record["maps_equal"] and not record["equal_to_offline"]


@pytest.mark.parametrize("world", ["2d", "3d"])
def test_the_pose_of_now_goes_on_from_the_map_of_the_team(world: str) -> None:
    log = team(world, robots=2, poses=40, landmarks=8, sees=0.5)
    robot = Robot.of(log, 2, PIECES)
    for _, tables in replayed(log, 2):
        robot = robot.step(tables).close()
    others = [build(piece) for piece in split(log.of_robot(1), poses_per_piece=12)]
    own = [build(piece) for number in range(len(robot.closed)) for piece in robot.pieces(number)]
    start = start_of(built(Atlas(), robot).in_short(others, 2), robot.since, robot.options.landmarks)
    whole = join([*own, *others]).map
    assert start is not None and start.key == robot.since and start.frame == whole.base
    expected = Covariances.of_map(whole)
    assert start.ahead is not None and start.ahead.order.keys[0] == start.key
    joint = expected.joint(start.ahead.order.keys)
    np.testing.assert_allclose(start.ahead.covariance, joint, rtol=1e-6, atol=1e-9 * np.abs(joint).max())
    np.testing.assert_allclose(
        start.pose_covariance, expected.of(start.key), rtol=1e-6, atol=1e-9 * np.abs(joint).max()
    )
    off = start.pose[None].minus(whole.values.pose(start.key)[None])[0]
    assert np.abs(off).max() < 1e-6


def test_what_does_not_go_together_is_left_to_itself() -> None:
    log = team("2d", robots=1, poses=30, landmarks=6)
    robot = Robot.of(log, 1, PIECES)
    for _, tables in replayed(log, 1):
        robot = robot.step(tables).close()
    one = build(split(log, poses_per_piece=12)[0])
    other = replace(one, id="other", sources=Sources(replace(rows, robot=2) for rows in one.sources))
    twice = [other, replace(other, id="again")]  # the same rows in two submaps
    _, alone = mapped(Atlas(), robot)
    _, beside = mapped(Atlas(), robot, twice)
    assert alone is not None and beside is not None
    np.testing.assert_allclose(alone.covariance, beside.covariance, rtol=1e-6, atol=1e-12)
