"""A robot without odometry has poses where it saw something; those that saw one landmark alone make no maps."""

from dataclasses import replace

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, JoinOptions
from teamslam.model import Dataset, Table, is_landmark, is_pose, robot_of
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


def test_a_pose_whose_sightings_fix_its_place_is_not_said_to_be_open() -> None:
    """Three landmarks seen whole hold a pose; where one of them was taken for another, it has no place all the same."""
    log = team("2d", robots=1, poses=8, seed=1, landmarks=4, sees=1.0, model="point", sigma=1e-3, sigma_odometry=1e-3)
    last = int(log.pose_keys[1][-1])
    gone = log.with_tables(t.select((t.keys != last).all(1)) if t.source == "odometry" else t for t in log.tables)
    swapped = gone.with_tables(_misnamed(t, last) if t.source == "landmarks" else t for t in gone.tables)
    assert not ts.run(gone).joined.left_out
    (lost,) = ts.run(swapped).joined.left_out
    assert (lost.kind, lost.keys.tolist()) == ("poses", [last])
    assert "no place was found" in lost.reason and "is open" not in lost.reason


def _misnamed(table: Table, pose: int) -> Table:
    """The sightings of one pose, each of the landmark that is next on the list."""
    keys, mine = table.keys.copy(), table.keys[:, 0] == pose
    keys[mine, 1] = np.roll(keys[mine, 1], 1)
    return replace(table, keys=keys)
