"""A robot with one pose, or with none that anything hangs on, costs nobody else anything, and a log of such is told."""

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, JoinOptions
from teamslam.errors import ModelError, SolveError
from teamslam.model import Dataset, Loss
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
def test_a_lone_pose_that_saw_others_under_a_loss_that_forgives_says_so(config: Config) -> None:
    log = team("2d", robots=2).with_loss(Loss("huber", 1.0))
    first = log.pose_keys[2][0]
    once = [t.select(t.keys[:, 0] == first) for t in log.tables if t.robot == 2 and t.source == "robots"]
    (lost,) = ts.run(log.with_tables([*(t for t in log.tables if t.robot == 1), *once]), config).joined.left_out[:1]
    assert lost.kind == "piece" and "a loss forgives" in lost.reason


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
