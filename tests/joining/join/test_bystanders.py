"""A robot without odometry has poses where it saw something; those that saw one landmark alone make no maps."""

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, JoinOptions
from teamslam.model import Dataset, is_landmark, is_pose, robot_of
from worlds import team

METHODS = [
    Config(),
    Config(method="full"),
    Config(join=JoinOptions(exact=True)),
    Config(join=JoinOptions(order="tree")),
]


def without_odometry(log: Dataset, robot: int) -> Dataset:
    return log.with_tables(t for t in log.tables if t.robot != robot or t.source != "odometry")


def seen_alone(log: Dataset, robot: int) -> set[int]:
    """Poses of a robot from which one landmark was seen, and which no row of another robot speaks of."""
    rows = np.concatenate([t.keys for t in log.tables if t.keys.shape[1] == 2])
    about = {int(k): rows[(rows == k).any(1)] for k in log.pose_keys[robot]}
    alone = {key for key, own in about.items() if len(own) == 1 and is_landmark(own[0, 1])}
    return alone


@pytest.mark.parametrize("config", METHODS)
@pytest.mark.parametrize("seed", range(2))
def test_poses_that_saw_one_landmark_are_told_of_in_one_line(config: Config, seed: int) -> None:
    log = without_odometry(
        team("2d", robots=3, poses=20, seed=seed, sees=0.25, model="range_bearing", robot_model="range_bearing"), 3
    )
    joined = ts.run(log, config).joined
    alone = seen_alone(log, 3)
    assert alone, "the world has none: no test"
    told = [lost for lost in joined.left_out if lost.kind == "poses" and "no odometry leads there" in lost.reason]
    assert len(told) == 1 and alone <= set(told[0].keys.tolist())
    assert all((is_pose(c.map.keys) & (robot_of(c.map.keys) > 0)).sum() > 1 for c in joined.components)
    out = np.concatenate([np.zeros(0, np.int64), *(lost.keys for lost in joined.left_out)])
    held = np.concatenate([c.map.keys for c in joined.components])
    assert np.isin(log.layout.keys, np.concatenate([out, held])).all()
