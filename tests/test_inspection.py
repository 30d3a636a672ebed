"""A log is looked over: counts add up, links that hold are told from those that do not, oddities are named."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.geometry import IntArray
from teamslam.inspection import inspect
from teamslam.model import Dataset, Table, is_landmark, is_pose, robot_of, unnamed_key
from teamslam.pipeline import run
from worlds import team as small_team


def keep(dataset: Dataset, wanted) -> Dataset:
    """The rows that `wanted(table)` masks."""
    return dataset.with_tables(table.select(wanted(table)) for table in dataset.tables)


def only_shared(dataset: Dataset, shared: IntArray) -> Dataset:
    """No robot sees another; landmarks outside `shared` are seen by robot 1 alone."""

    def wanted(table: Table) -> np.ndarray:
        target = table.keys[:, 1]
        sees_robot = is_pose(target) & (robot_of(target) != table.robot)
        private = is_landmark(target) & ~np.isin(target, shared) & (table.robot != 1)
        return ~sees_robot & ~private

    return keep(dataset, wanted)


def test_counts_add_up_to_the_tables() -> None:
    """Every row is counted once, poses and landmarks as the dataset has them."""
    team = small_team(robots=3, poses=10, landmarks=4)
    found = inspect(team)
    assert sum(c.rows for c in found.counts) == sum(len(t) for t in team.tables)
    assert found.poses == {1: 10, 2: 10, 3: 10} and found.landmarks == 4 and found.has_truth


@pytest.mark.parametrize(
    ("world", "shared", "holds"),
    [
        ("2d", 0, False),
        ("2d", 1, False),
        ("2d", 2, True),
        ("3d", 2, False),
        ("3d", 3, True),
        ("planar", 2, True),
    ],
)
def test_points_hold_a_frame_where_there_are_enough_of_them(world: str, shared: int, holds: bool) -> None:
    """Two in the plane, three in space: the closed-form fit needs as many."""
    team = only_shared(small_team(world, robots=2, landmarks=6, sees=1.0), np.arange(shared))
    found = inspect(team)
    assert (found.groups == ((1, 2),)) is holds
    assert [link.landmarks for link in found.links] == ([shared] if shared else [])
    if not holds:
        assert any("cannot be joined" in hint and "would join them" in hint for hint in found.hints)


def test_one_sighting_of_a_pose_holds_a_frame() -> None:
    """A relative pose fixes everything."""
    team = keep(small_team(robots=2, every=100), lambda t: robot_of(t.keys[:, 1]) > 0)
    found = inspect(team)
    assert found.groups == ((1, 2),) and [link.landmarks for link in found.links] == [0]


def test_a_robot_without_odometry_or_sightings_is_named() -> None:
    """Broken chains and blind robots are told before anything is solved."""
    team = small_team(robots=2, poses=12)
    gone = keep(team, lambda t: ~((t.source == "odometry") & (t.robot == 2) & (np.arange(len(t)) == 5)))
    assert any("robot 2: odometry is missing before 1 of its 12 poses" in hint for hint in inspect(gone).hints)
    blind = keep(team, lambda t: np.full(len(t), t.source == "odometry" or t.robot != 1))
    unseen = keep(blind, lambda t: np.full(len(t), t.source != "robots"))
    for log, wanted in ((blind, "only where others saw it"), (unseen, "its map is dead reckoning")):
        assert any(hint.startswith(f"robot 1 saw nothing: {wanted}") for hint in inspect(log).hints)


def test_sightings_without_a_name_are_no_landmarks_and_may_join_what_names_do_not() -> None:
    """A run finds out which are of one landmark: none was seen once for want of a name, and no robot is apart."""
    team = only_shared(small_team("2d", robots=2, landmarks=6, sees=1.0), np.arange(1))
    bare = [
        replace(t, keys=np.stack([t.keys[:, 0], unnamed_key(1, t.ids)], -1))
        if (t.robot, t.source) == (1, "landmarks")
        else t
        for t in team.tables
    ]
    count = sum(len(t) for t in bare if (t.robot, t.source) == (1, "landmarks"))
    found = inspect(team.with_tables(bare))
    assert inspect(team).groups == ((1,), (2,)) and found.groups == ((1, 2),) and found.landmarks == 1
    assert any(hint.startswith(f"robot 1: {count} sightings are of landmarks without") for hint in found.hints)
    assert not any("cannot be joined" in hint or "seen only once" in hint for hint in found.hints)


def test_landmarks_seen_once_are_named() -> None:
    """Nothing would show that such a sighting is wrong."""
    team = small_team(robots=1, poses=5, landmarks=3, sees=1.0)
    team = keep(team, lambda t: (t.source == "odometry") | (t.keys[:, 0] == t.keys[0, 0]))
    assert any("3 landmarks were seen only once (0, 1, 2)" in hint for hint in inspect(team).hints)


def test_no_truth_is_said() -> None:
    """Nobody waits for errors that cannot be."""
    team = small_team()
    blank = Dataset(team.robots, team.tables, team.names)
    assert any("no truth" in hint for hint in inspect(blank).hints)
    assert not any("no truth" in hint for hint in inspect(team).hints)


def sharing(seen: dict[int, list[int]]) -> Dataset:
    """No robot sees another; each sees its own landmarks, all in the plane."""
    whole = small_team("2d", robots=len(seen), poses=12, landmarks=8, sees=1.0)

    def wanted(table: Table) -> np.ndarray:
        target = table.keys[:, 1]
        sees_robot = is_pose(target) & (robot_of(target) != table.robot)
        return ~sees_robot & (~is_landmark(target) | np.isin(target, seen[table.robot]))

    return keep(whole, wanted)


@pytest.mark.parametrize(
    ("seen", "groups"),
    [
        ({1: [0, 1, 2], 2: [0, 1, 3], 3: [2, 3]}, ((1, 2, 3),)),  # 3 has one landmark with each, two with both
        ({1: [0, 1], 2: [1, 2], 3: [2, 0]}, ((1, 2, 3),)),  # a ring: a truss of three bars
        ({1: [0, 1], 2: [0, 1], 3: [1, 4]}, ((1, 2), (3,))),
        ({1: [0, 1], 2: [1, 2], 3: [2, 5]}, ((1,), (2,), (3,))),  # a row of hinges
    ],
)
def test_groups_are_those_that_a_run_joins(seen: dict[int, list[int]], groups: tuple[tuple[int, ...], ...]) -> None:
    """Robots that are held by several others together are not told that they cannot be joined."""
    log = sharing(seen)
    assert inspect(log).groups == groups
    components = run(log).joined.components
    assert sorted(component.map.robots_in_it for component in components) == list(groups)


def test_time_counts_from_the_first_pose() -> None:
    """Not from the end of the first step."""
    found = inspect(small_team(robots=1, poses=5))
    odometry = next(count for count in found.counts if count.source == "odometry")
    assert (odometry.start_s, odometry.stop_s) == (0.0, 4.0)
