"""The world's frame is taken where enough was measured in it; until then, or where that never comes, rows wait."""

import numpy as np
import pytest

import teamslam as ts
from teamslam.config import Config, JoinOptions, SplitOptions
from teamslam.joining import ORDERS, Joined, build, join, split
from teamslam.model import WORLD, Dataset
from worlds import WORLDS, measure, mixed_team, team

SIGMA = 0.02


def surveyed(log: Dataset, every: int, robots: tuple[int, ...] = (1,), model: str = "position") -> Dataset:
    """The log with every so-manieth pose of some robots measured in the world."""
    assert log.truth is not None
    rng = np.random.default_rng(3)
    rows = [
        measure(r, "world", model, log.robots[r], log.pose_keys[r][::every, None], SIGMA, log.truth, rng)
        for r in robots
    ]
    return log.with_tables([*log.tables, *rows])


def error(joined: Joined, log: Dataset) -> float:
    """The largest error of a map in the world's frame, against the truth as it stands."""
    assert log.truth is not None and joined.map.base == WORLD
    values = joined.map.values
    return float(np.abs(log.truth.only(values.layout.keys).minus(values)).max())


@pytest.mark.parametrize("order", list(ORDERS))
@pytest.mark.parametrize("world", WORLDS)
def test_rows_of_the_world_wait_until_what_is_joined_holds_the_frame(world: str, order: str) -> None:
    """Each piece alone has one position or two: in space no piece knows how it is turned, the team does."""
    log = surveyed(team(world, robots=2, sigma=SIGMA, sigma_odometry=SIGMA), 3)
    joined = ORDERS[order](build(piece) for piece in split(log, poses_per_piece=4))
    assert len(joined.components) == 1 and not joined.map.raw
    assert error(joined, log) < 30.0 * SIGMA


@pytest.mark.parametrize("order", list(ORDERS))
@pytest.mark.parametrize("robot", [1, 2])
def test_a_robot_of_a_plane_joins_a_map_of_the_world(robot: int, order: str) -> None:
    """A planar robot and one in space, one of which knows the world before it meets the other: in
    whatever order, the map is in the world's frame and near the truth."""
    log = surveyed(mixed_team(SIGMA), 3, (robot,))
    joined = ORDERS[order](build(piece) for piece in split(log, poses_per_piece=5))
    assert len(joined.components) == 1 and not joined.map.raw
    assert error(joined, log) < 30.0 * SIGMA


METHODS = [Config(), Config(method="full"), Config(join=JoinOptions(exact=True)), Config(split=SplitOptions(4))]


@pytest.mark.parametrize("config", METHODS)
@pytest.mark.parametrize("world", WORLDS)
def test_one_position_leaves_the_map_in_its_first_poses_frame(world: str, config: Config) -> None:
    """The map is that of the log without the position, which is told to be left out."""
    bare = team(world, robots=2, sigma=SIGMA, sigma_odometry=SIGMA)
    found, without = ts.run(surveyed(bare, 100), config), ts.run(bare, config)
    assert found.map.base == without.map.base != WORLD
    np.testing.assert_allclose(found.map.values.state, without.map.values.state, atol=1e-9)
    assert found.costs == without.costs
    (lost,) = found.joined.left_out
    assert (lost.kind, lost.count, lost.what) == ("rows", 1, "world of robot 1")
    assert "free to shift or turn in the world" in lost.reason


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("model", ["position", "pose"])
def test_robots_that_only_the_world_holds_are_one_map(world: str, model: str) -> None:
    """They never met, and share no landmark: each knows where it is in the world, and so where the other is."""
    log = team(world, robots=2, sigma=SIGMA, sigma_odometry=SIGMA)
    apart = log.with_tables(t for t in log.tables if t.source == "odometry")
    joined = join([build(piece) for piece in split(surveyed(apart, 2, (1, 2), model))])
    assert len(joined.components) == 1 and joined.reasons == ()
    assert error(joined, log) < 30.0 * SIGMA
