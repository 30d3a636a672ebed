"""The pose of now: that of the least squares of all rows so far, from a filter that carries little."""

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arrivals import in_time, shaken
from teamslam.geometry import Pose
from teamslam.joining import full
from teamslam.live import drive
from teamslam.model import Dataset, Table, is_landmark
from teamslam.robot import Estimate, Options, Robot
from teamslam.solver import Covariances
from teamslam.wire.messages import canonical
from worlds import WORLDS, team

ALL = Options(poses_per_piece=None)


def driven(log: Dataset, robot: int, options: Options, rows: Iterable[list[Table]]) -> Robot:
    out = Robot.of(log, robot, options)
    for tables in rows:
        out = out.step(tables)
    return out


def without_robots(log: Dataset) -> Dataset:
    return log.with_tables(table for table in log.tables if not table.observes_robots)


def in_sigmas(now: Estimate, pose: Pose) -> float:
    off = now.pose[None].minus(pose[None])[0]
    return float(np.sqrt(off @ np.linalg.solve(now.covariance, off)))


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("pieces", [None, 8])
def test_to_first_order_it_is_that_of_the_least_squares_of_all_rows(world: str, pieces: int | None) -> None:
    """What is left, in sigmas, goes with the noise."""
    for noise in (1e-2, 1e-4):
        log = without_robots(team(world, robots=1, poses=45, landmarks=7, sigma=noise, sigma_odometry=noise))
        *moments, _ = drive(Robot.of(log, 1, Options(poses_per_piece=pieces)), (t for _, t in in_time(log, 1)))
        now, best = moments[-1].now, full(log).map
        assert now is not None and now.frame == best.base and now.key == log.pose_keys[1][-1]
        root = np.linalg.inv(np.linalg.cholesky(Covariances.of_map(best).of(now.key)))
        assert in_sigmas(now, best.all_values.pose(now.key)) < 50.0 * noise
        assert np.abs(root @ now.covariance @ root.T - np.eye(len(root))).max() < 20.0 * noise


@pytest.mark.parametrize("world", ["2d", "3d"])
def test_where_the_way_is_hardly_known_it_is_still_that_of_the_least_squares(world: str) -> None:
    """No loop has closed, and the heading is known less and less: what rows lose that are linearised at one heading and
    at another must stay far below what the way is known by."""
    log = without_robots(team(world, robots=1, poses=100, landmarks=40, sees=0.6, sigma=0.02, sigma_odometry=0.02))
    keys, worst = log.pose_keys[1], 0.0
    for moment in drive(Robot.of(log, 1, Options(poses_per_piece=40)), (t for _, t in in_time(log, 1))):
        now = moment.now
        if now is None or now.key not in keys[39::50]:
            continue
        far = [table.select((is_landmark(table.keys) | (table.keys <= now.key)).all(-1)) for table in log.tables]
        worst = max(worst, in_sigmas(now, full(log.with_tables(far)).map.all_values.pose(now.key)))
    assert worst < 0.2


def test_a_landmark_far_from_where_the_submap_began_is_known_when_it_is_seen() -> None:
    """Few may be carried, and the robot drives away from all that were near: those that come are told by the map."""
    log = without_robots(team("2d", robots=1, poses=90, landmarks=24, sees=0.25, sigma=1e-3, sigma_odometry=1e-3))
    *moments, _ = drive(Robot.of(log, 1, Options(poses_per_piece=40, landmarks=20)), (t for _, t in in_time(log, 1)))
    filter_, now = moments[-1].robot.trail[-1].filter, moments[-1].now
    assert filter_ is not None and now is not None and len(filter_.told) > 10
    assert in_sigmas(now, full(log).map.all_values.pose(now.key)) < 0.1


def test_with_hardly_any_noise_it_is_the_truth() -> None:
    log = team("3d", robots=1, poses=30, sigma=1e-6, sigma_odometry=1e-6)
    now = driven(log, 1, ALL, (tables for _, tables in in_time(log, 1))).now
    assert now is not None and log.truth is not None
    true = log.truth.pose(now.frame).between(log.truth.pose(now.key))
    assert np.allclose(now.pose.translation, true.translation, atol=1e-4)
    assert np.allclose(now.pose.rotation, true.rotation, atol=1e-4)


@settings(max_examples=8, deadline=None)
@given(world=st.sampled_from(WORLDS), seed=st.integers(0, 1000), horizon=st.integers(1, 12))
def test_the_order_within_the_horizon_changes_no_bit_of_it(world: str, seed: int, horizon: int) -> None:
    log = team(world, robots=1, poses=25, seed=seed)
    options = Options(poses_per_piece=None, horizon_s=float(horizon))
    single = [[table.select([n])] for _, tables in in_time(log, 1) for table in tables for n in range(len(table))]
    straight = driven(log, 1, options, single).now
    other = driven(
        log, 1, options, ([row] for row in shaken(in_time(log, 1), horizon, np.random.default_rng(seed)))
    ).now
    assert straight is not None and other is not None
    assert (straight.key, straight.frame) == (other.key, other.frame)
    assert np.array_equal(straight.pose.translation, other.pose.translation)
    assert np.array_equal(straight.covariance, other.covariance)


def test_a_landmark_seen_long_ago_corrects_the_pose_now() -> None:
    log = team("2d", robots=1, poses=160, landmarks=6, sees=1.0, sigma_odometry=0.02, sigma=0.01)
    odometry, landmarks = log.tables
    ticks = landmarks.keys[:, 0] - log.pose_keys[1][0]
    blind = landmarks.select((ticks < 20) | (ticks == 159))
    sigmas = []
    seldom = log.with_tables([odometry, blind])
    *moments, _ = drive(Robot.of(seldom, 1, Options(poses_per_piece=20)), (t for _, t in in_time(seldom, 1)))
    for moment in moments:
        assert moment.now is not None
        sigmas.append(float(np.sqrt(np.trace(moment.now.covariance[:2, :2]))))
        last = moment.now
    assert log.truth is not None
    assert sigmas[158] > 0.3 and sigmas[159] < 0.05
    assert in_sigmas(last, log.truth.pose(last.frame).between(log.truth.pose(last.key))) < 4.0


def test_it_carries_no_more_landmarks_than_it_may_and_its_open_rows_do_not_pile_up() -> None:
    log = team("2d", robots=1, poses=120, landmarks=30)
    options = Options(poses_per_piece=10, landmarks=5)
    for moment in drive(Robot.of(log, 1, options), (tables for _, tables in in_time(log, 1))):
        filter_ = moment.robot.trail[-1].filter
        assert filter_ is not None and len(filter_.order.place) <= 5 and len(moment.robot.trail) <= 4
        assert len({batch.time for batch in moment.robot.open}) <= 10 + 4


def test_where_odometry_is_missing_the_pose_is_told_in_a_frame_of_its_own() -> None:
    log = team("2d", robots=1, poses=30)
    odometry, landmarks = log.tables
    keys = log.pose_keys[1]
    cut = log.with_tables([odometry.select(odometry.keys[:, 0] != keys[14]), landmarks])
    moments = drive(Robot.of(cut, 1, ALL), (t for _, t in in_time(cut, 1)))
    frames = [moment.now.frame for moment in moments if moment.now is not None]
    assert frames[:15] == [keys[0]] * 15 and set(frames[15:]) == {keys[15]}
    # When the missing row comes after all, within the horizon, nothing of it is left.
    robot = driven(cut, 1, Options(poses_per_piece=None, horizon_s=30.0), (t for _, t in in_time(cut, 1)))
    assert robot.now is not None and robot.now.frame == keys[15]
    mended = robot.step([odometry.select(odometry.keys[:, 0] == keys[14])]).now
    assert mended is not None and mended.frame == keys[0]


@pytest.mark.parametrize("process", [False, True])
def test_closing_beside_the_steps_gives_the_same_submaps(process: bool) -> None:
    log = team("planar", robots=1, poses=40)
    rows = [tables for _, tables in in_time(log, 1)]
    options = Options(poses_per_piece=10)
    with ProcessPoolExecutor(1, get_context("spawn")) if process else ThreadPoolExecutor(1) as executor:
        beside = [s for moment in drive(Robot.of(log, 1, options), rows, executor=executor) for s in moment.submaps]
    between = [s for moment in drive(Robot.of(log, 1, options), rows) for s in moment.submaps]
    assert sorted(map(canonical, beside)) == sorted(map(canonical, between))
