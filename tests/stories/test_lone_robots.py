"""A robot with one pose, or with none that anything hangs on, costs nobody else anything, and a log of such is told."""

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, JoinOptions
from teamslam.errors import ModelError, SolveError
from teamslam.geometry import Pose
from teamslam.model import Dataset, Loss, Table, pack
from worlds import team

METHODS = [
    Config(),
    Config(method="full"),
    Config(join=JoinOptions(exact=True)),
    Config(join=JoinOptions(order="sequential")),
    Config(join=JoinOptions(order="tree")),
]


def standing(log: Dataset, robot: int) -> Dataset:
    """The log, of a robot only what it saw by bearings from its first pose."""
    first = log.pose_keys[robot][0]
    return log.with_tables(
        t if t.robot != robot else t.select(t.keys[:, 0] == first)
        for t in log.tables
        if t.robot != robot or t.source == "landmarks"
    )


@pytest.mark.parametrize("config", METHODS)
def test_a_robot_that_stood_alone_is_left_out_by_name(config: Config) -> None:
    log = team("2d", robots=2, model="bearing", sees=1.0, landmarks=8)
    log = standing(log.with_tables(t for t in log.tables if t.source != "robots"), 2)
    joined = ts.run(log, config).joined
    alone = joined.components[0].map
    assert np.isin(log.pose_keys[1], alone.keys).all()
    told = [lost for lost in joined.left_out if lost.kind == "piece"]
    in_a_map = any(np.isin(log.pose_keys[2], c.map.keys).all() for c in joined.components)
    assert in_a_map or "stands alone" in told[0].reason


@pytest.mark.parametrize("config", METHODS)
def test_a_lone_pose_that_saw_another_robot_is_placed_by_it_as_a_way_is(config: Config) -> None:
    log = team("2d", robots=2).with_loss(Loss("huber", 1.0))
    first = log.pose_keys[2][0]
    once = [t.select(t.keys[:, 0] == first) for t in log.tables if t.robot == 2 and t.source == "robots"]
    joined = ts.run(log.with_tables([*(t for t in log.tables if t.robot == 1), *once]), config).joined
    assert joined.map.all_values.layout.contains(first)
    assert "piece" not in {lost.kind for lost in joined.left_out}


@pytest.mark.parametrize("config", METHODS)
def test_what_a_lone_pose_measured_counts_where_others_hold_it(config: Config) -> None:
    """A robot that stands still, without odometry, and ranges to another one: its place comes of all its ranges."""
    log = team("2d", robots=2)
    first, second = log.pose_keys[1][0], log.pose_keys[2][0]
    poses = log.pose_keys[1][:6]
    far = np.linalg.norm(log.truth.positions(poses, 2) - log.truth.positions(second, 2), axis=-1)
    truth = log.truth.pose(first).between(log.truth.pose(second))
    roughly = pack(Pose(truth.rotation, truth.translation + np.array([1.0, -1.0])))[None]
    seen = Table(1, "robots", "relative_pose", 2, np.array([[first, second]]), roughly, np.eye(3)[None], np.arange(1))
    keys = np.stack([np.full(6, second), poses], -1)
    ranges = Table(2, "ranges", "range", 2, keys, far[:, None], 100.0 * np.ones((1, 1, 1)), np.arange(6))
    own = [t for t in log.tables if t.robot == 1 and t.source != "robots"]
    joined = ts.run(log.with_tables([*own, seen, ranges]), config).joined
    assert not joined.left_out and len(joined.components) == 1
    found = joined.map.all_values.pose(first).between(joined.map.all_values.pose(second))
    assert np.linalg.norm(found.translation - truth.translation) < 0.3  # the sighting alone is off by more than a metre


@pytest.mark.parametrize("config", METHODS)
def test_a_log_of_nothing_but_lone_poses_ends_in_a_true_sentence(config: Config) -> None:
    log = team("2d", robots=1, model="bearing", sees=1.0, landmarks=8)
    with pytest.raises(SolveError, match="stands alone: no odometry leads to it or from it"):
        ts.run(standing(log, 1), config)


@pytest.mark.parametrize("config", METHODS)
def test_a_log_without_rows_says_that_there_is_nothing_to_join(config: Config) -> None:
    log = team("2d", robots=1)
    with pytest.raises(ModelError, match="nothing to join"):
        ts.run(log.with_tables([]), config)
