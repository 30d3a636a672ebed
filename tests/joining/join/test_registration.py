"""A map goes into the world by what rows tell of it, and by nothing that they do not tell."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import generators, random_poses
from teamslam.config import Config
from teamslam.geometry import Pose
from teamslam.joining.join.registration import registered
from teamslam.model import WORLD, Dataset, Table, Values, pack, pose_key, pose_kind
from teamslam.pipeline import run
from worlds import measure, team


def placed(rng: np.random.Generator, dim: int, n: int = 25) -> tuple[Values, np.ndarray, Pose]:
    """Poses of a map, their keys, and a motion of all of it."""
    keys = pose_key(1, np.arange(n))
    return Values.of({pose_kind(dim): (keys, random_poses(rng, dim, n))}), keys, random_poses(rng, dim, 1, turn=3.0)[0]


def rows(keys: np.ndarray, goals: np.ndarray, told: np.ndarray, rng: np.random.Generator) -> Table:
    """Places in the world of which only some numbers (n, d) are told; the others are nonsense."""
    n, d = goals.shape
    whitening = 50.0 * told[:, :, None] * np.eye(d)
    numbers = np.where(told, goals, rng.normal(0.0, 1e3, (n, d)))
    return Table(1, "fixes", "position", d, keys[:, None], numbers, whitening, np.arange(n))


@settings(max_examples=30, deadline=None)
@given(generators, st.sampled_from([2, 3]))
def test_a_map_that_was_moved_goes_there_by_one_number_of_each_place(rng: np.random.Generator, dim: int) -> None:
    values, keys, motion = placed(rng, dim)
    goals = motion.act(values.positions(keys, dim))
    told = np.eye(dim, dtype=bool)[np.arange(len(keys)) % dim]
    found = registered(values, [rows(keys, goals, told, rng)], dim)
    assert found.rank == len(found.information)
    np.testing.assert_allclose(found.pose.act(values.positions(keys, dim)), goals, atol=1e-4)


def test_depth_tells_height_and_tilt_alone() -> None:
    rng = np.random.default_rng(1)
    values, keys, _ = placed(rng, 3)
    goals = values.positions(keys, 3)
    depth = rows(keys, goals, np.tile([False, False, True], (len(keys), 1)), rng)
    assert registered(values, [depth], 3).rank == 3


def test_a_tilt_that_is_known_and_one_place_leave_the_heading() -> None:
    rng = np.random.default_rng(2)
    _, keys, _ = placed(rng, 3)
    whitening = np.tile(np.diag([0.0, 0.0, 0.0, 50.0, 50.0, 0.0]), (len(keys), 1, 1))
    level = Values.of({pose_kind(3): (keys, Pose.identity(3, (len(keys),)))})
    flat = Table(1, "tilt", "pose", 3, keys[:, None], pack(level.poses_of(keys, 3)), whitening, np.arange(len(keys)))
    fix = rows(keys[:1], np.zeros((1, 3)), np.ones((1, 3), bool), rng)
    assert registered(level, [flat, fix], 3).rank == 5


@pytest.mark.parametrize("method", ["join", "full"])
def test_depths_beside_a_few_fixes_put_a_team_where_it_is(method: str) -> None:
    """What depths do not tell is nonsense in the file, and moves nobody."""
    log = team("3d", robots=2, poses=40, landmarks=8)
    assert log.truth is not None
    rng = np.random.default_rng(3)
    tables = list[Table]()
    for robot in (1, 2):
        keys = log.pose_keys[robot]
        goals = log.truth.positions(keys, 3) + rng.normal(0.0, 0.02, (len(keys), 3))
        tables.append(rows(keys, goals, np.tile([False, False, True], (len(keys), 1)), rng))
    tables[1] = replace(tables[1], robot=2)
    fixes = measure(1, "gps", "position", 3, log.pose_keys[1][::10, None], 0.02, log.truth, rng)
    found = run(log.with_tables([*log.tables, *tables, fixes]), Config(method=method, calibrate=False))  # type: ignore[arg-type]
    assert found.map.base == WORLD and not found.joined.left_out
    assert isinstance(found.dataset, Dataset) and 0.6 < found.scores[0].nees_per_dof < 1.5
