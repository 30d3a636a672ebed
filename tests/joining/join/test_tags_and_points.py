"""A landmark that one submap holds as a pose and another as a point is one pose; by join in all orders, exact and full.

Each robot sees the landmarks in a way of its own: as tags (poses), as points, as both, as the shadows of points (in the
plane of the robot, though they are in space), or as tags of which a direction is not told.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.geometry import Pose
from teamslam.io.submaps.arrays import read_submap, write_submap
from teamslam.joining import ORDERS, accounted, build, exact_join, full, join, split
from teamslam.joining.start.starts import driven_start, local_kinds
from teamslam.model import Dataset, Kind, Submap, Table, Values, index_of, is_landmark, landmark_key, pose_key
from worlds import WORLDS, measure, team

SEEN = ("tags", "points", "both")
POSES, TAGS = 8, 5
LARGEST = 1e-3  # of what joins leave to second order in the noise, in their own sigmas


def tagged(world: str, seen: Sequence[str], sigma: float = 1e-3, seed: int = 0) -> Dataset:
    """Robots among tags, each seeing them in its own way and the next robot now and then."""
    log = team(world, robots=len(seen), poses=POSES, landmarks=TAGS, sigma=sigma, sigma_odometry=sigma, seed=seed)
    assert log.truth is not None
    rng, dim = np.random.default_rng(seed), 2 if world == "2d" else 3
    marks = landmark_key(np.arange(TAGS))
    turns = rng.uniform(-2.0, 2.0, (TAGS, 2 * dim - 3))
    tags = Pose.from_tangent(np.concatenate([log.truth.positions(marks, dim), turns], -1), dim)
    poses = log.truth.select(~is_landmark(log.truth.layout.keys))
    truth = Values.together([poses, Values.of({Kind(dim - 2): (marks, tags)})])
    tables = [t for t in log.tables if t.source != "landmarks"]
    for robot, how in enumerate(seen, start=1):
        pairs = np.stack([np.repeat(pose_key(robot, np.arange(POSES)), TAGS), np.tile(marks, POSES)], -1)[::2]
        if how in ("tags", "both", "half tags"):
            tags_seen = measure(robot, "tags", "relative_pose", dim, pairs, sigma, truth, rng)
            tables.append(half_blind(tags_seen) if how == "half tags" else tags_seen)
        if how in ("points", "both"):
            tables.append(measure(robot, "points", "point", dim, pairs, sigma, truth, rng))
        if how == "shadows":
            tables.append(measure(robot, "points", "point", 2, pairs, sigma, truth, rng))
    return replace(log, tables=tuple(tables), truth=truth)


def half_blind(table: Table) -> Table:
    """Rows that say nothing of the first direction."""
    said = np.ones(table.whitening.shape[1])
    said[0] = 0.0
    return replace(table, whitening=said[:, None] * table.whitening)


def built(log: Dataset) -> list[Submap]:
    return [build(piece) for piece in split(log)]


def kinds_of_landmarks(values: Values) -> set[Kind]:
    return {Kind(int(k)) for k in values.layout.kinds[is_landmark(values.layout.keys)]}


@pytest.mark.parametrize("world", WORLDS)
@given(seen=st.lists(st.sampled_from(SEEN), min_size=2, max_size=4), seed=st.integers(0, 99))
@settings(max_examples=4, deadline=None)
def test_exact_and_full_agree_and_the_join_is_near_in_every_order(world: str, seen: list[str], seed: int) -> None:
    log = tagged(world, seen, seed=seed)
    exact, whole, submaps = exact_join(split(log)), full(log), built(log)
    assert exact.converged and whole.converged and len(whole.components) == 1
    assert all(kind.is_pose == (set(seen) != {"points"}) for kind in kinds_of_landmarks(whole.map.values))
    np.testing.assert_allclose(exact.map.values.minus(whole.map.values), 0.0, atol=1e-8)
    for order in ORDERS.values():
        joined = order(submaps)
        assert joined.converged and len(joined.components) == 1
        off = joined.map.values.minus(whole.map.values)
        assert float(off @ (whole.map.information @ off)) < LARGEST
        assert not accounted(log, joined).left_out


def test_the_order_in_which_submaps_come_changes_nothing_to_the_bit() -> None:
    submaps = built(tagged("planar", ["points", "tags", "both"]))
    one, other = join(submaps).map, join(submaps[::-1]).map
    np.testing.assert_array_equal(one.values.state, other.values.state)


def test_pieces_of_one_robot_may_differ() -> None:
    """The first half of its way it reads the tags, the second it sees them from afar."""
    log = tagged("3d", ["both"])
    early = pose_key(1, POSES // 2)
    tables = [
        t.select(t.keys[:, 0] < early) if t.source == "tags" else t.select(t.keys[:, 0] >= early)
        if t.source == "points" else t
        for t in log.tables
    ]  # fmt: skip
    log = replace(log, tables=tuple(tables))
    pieces = split(log, poses_per_piece=POSES // 2)
    submaps = [build(piece) for piece in pieces]
    assert {frozenset(kinds_of_landmarks(s.values)) for s in submaps} == {frozenset({k}) for k in (1, 3)}
    whole = full(log)
    np.testing.assert_allclose(exact_join(pieces).map.values.minus(whole.map.values), 0.0, atol=1e-8)


@pytest.mark.parametrize("others", ["tags", "points"])
def test_shadows_of_what_is_in_space(others: str) -> None:
    """A planar sensor holds the shadow of a point in its submap; joined with what saw it in space, it is there."""
    log = tagged("planar", ["shadows", others])
    submaps, whole = built(log), full(log)
    assert {frozenset(kinds_of_landmarks(s.values)) for s in submaps} == {
        frozenset({Kind.POINT2}), frozenset({Kind.POSE3 if others == "tags" else Kind.POINT3})
    }  # fmt: skip
    off = join(submaps).map.values.minus(whole.map.values)
    assert float(off @ (whole.map.information @ off)) < LARGEST
    np.testing.assert_allclose(exact_join(split(log)).map.values.minus(whole.map.values), 0.0, atol=1e-8)


@pytest.mark.parametrize("world", WORLDS)
def test_tags_that_do_not_tell_all_wait_where_others_know_points(world: str) -> None:
    log = tagged(world, ["half tags", "points"])
    joined = accounted(log, join(built(log)))
    assert joined.converged and not accounted(log, full(log)).components[1:]
    held = {int(k) for k in joined.map.keys} | {int(k) for lost in joined.left_out for k in lost.keys}
    assert set(log.layout.keys.tolist()) <= held


def test_submaps_from_files(tmp_path: Path) -> None:
    submaps = built(tagged("3d", ["points", "tags"]))
    for number, submap in enumerate(submaps):
        write_submap(submap, tmp_path / f"{number}.submap")
    back = [read_submap(tmp_path / f"{number}.submap") for number in range(len(submaps))]
    np.testing.assert_array_equal(join(back).map.values.state, join(submaps).map.values.state)


@pytest.mark.parametrize("world", WORLDS)
def test_a_start_part_by_part_waits_for_how_a_tag_is_turned(world: str) -> None:
    """The first half of the way sees the places of tags alone: they are not put there as points, and none is lost."""
    log = tagged(world, ("both",))
    late = [t.select((index_of(t.keys[:, 0]) >= POSES // 2) == (t.source == "tags")) for t in log.tables[1:]]
    found = driven_start(log.with_tables([log.tables[0], *late]), 1, [log.tables[0], *late])
    kinds = local_kinds(log.layout, log.robots[1])
    assert found.layout.contains(landmark_key(np.arange(TAGS))).all()
    np.testing.assert_array_equal(found.layout.kinds, kinds.kinds[kinds.index(found.layout.keys)])
