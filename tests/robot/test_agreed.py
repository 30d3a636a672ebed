"""Poses by agreement: where others saw a robot between two of its poses it gets one, and all end with one map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.fleet import Fleet, Member, fleet
from teamslam.frontend.agreed import with_poses
from teamslam.frontend.keyframes import place_keyframes
from teamslam.joining import build, join, split
from teamslam.live import begun, replayed
from teamslam.model import Dataset, pose_key, robot_of
from teamslam.model.keys import unnamed_key
from teamslam.results.fleet import bits_of, joined, offline_submaps
from teamslam.robot import Options, Robot
from teamslam.robot.journal import Journal
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import announcements, opened
from teamslam.robot.packets import Announcement, to_bytes
from teamslam.robot.peer import Peer
from teamslam.robot.rows import head_of
from teamslam.team import Knowledge
from teamslam.team.knowledge import PAGE
from worlds import chain, measure, team

PIECES = Options(poses_per_piece=6)


def seen_between(world: str = "2d", poses: int = 24) -> Dataset:
    """Two robots without a landmark: the second has a pose every other moment, and is seen in between alone."""
    whole = team(world, robots=2, poses=poses, landmarks=0, every=1)
    assert whole.truth is not None
    rng, dim = np.random.default_rng(1), whole.robots[1]
    first, second = (whole.pose_keys[robot] for robot in (1, 2))
    pairs = np.stack([first[1::4], second[1::4]], -1)
    return whole.with_tables(
        [
            measure(1, "odometry", "relative_pose", dim, chain(first), 0.02, whole.truth, rng),
            measure(1, "robots", "relative_pose", dim, pairs, 0.02, whole.truth, rng),
            measure(2, "odometry", "relative_pose", dim, chain(second[::2]), 0.02, whole.truth, rng),
        ]
    )


LOG = seen_between()
NAMED = np.unique(LOG.tables[1].keys[:, 1])


def offline(log: Dataset) -> bytes:
    made = join(offline_submaps(log, PIECES))
    assert len(made.components) == 1
    return bits_of(made)


@pytest.mark.parametrize("world", ["2d", "3d"])
def test_odometry_is_cut_as_in_a_log_that_was_read_whole(world: str) -> None:
    log = seen_between(world)
    whole, dropped = place_keyframes(log.tables, [], tolerance=0, names=log.names)
    cut = with_poses(log.of_robot(2), 2, np.unique(log.tables[1].keys[:, 1]))
    assert not dropped and len(cut.tables[0]) > len(log.tables[2])
    for name in ("keys", "values", "whitening"):
        np.testing.assert_array_equal(getattr(cut.tables[0], name), getattr(whole[2], name))
    assert set(cut.tables[0].ids.tolist()) == set(log.tables[2].ids.tolist())  # the rows that it is made of


@given(st.lists(st.sampled_from(NAMED.tolist()), max_size=8), st.integers(0, 8))
def test_in_any_order_and_again(keys: list[int], first: int) -> None:
    log = LOG.of_robot(2)
    at_once = with_poses(log, 2, np.array(keys, np.int64))
    bit_by_bit = with_poses(with_poses(log, 2, np.array(keys[:first], np.int64)), 2, np.array(keys, np.int64))
    assert np.array_equal(at_once.pose_keys[2], np.union1d(log.pose_keys[2], np.array(keys, np.int64)))
    assert np.array_equal(at_once.pose_keys[2], bit_by_bit.pose_keys[2])
    assert with_poses(log, 2, log.pose_keys[2]) is log
    assert with_poses(log, 2, pose_key(2, np.array([10_000]))) is log


def test_what_bridges_poses_or_stands_twice_is_not_cut_again() -> None:
    steps = LOG.tables[2]
    closure = replace(steps.select(np.array([0])), keys=steps.keys[[0, 4], [0, 1]][None], ids=np.array([100]))
    again = replace(steps.select(np.array([1])), ids=np.array([101]))
    rows = replace(
        steps,
        **{n: np.concatenate([getattr(t, n) for t in (closure, steps, again)]) for n in ("keys", "values", "ids")},
    )
    cut = with_poses(LOG.of_robot(2).with_tables([rows]), 2, NAMED).tables[0]
    plain = with_poses(LOG.of_robot(2), 2, NAMED).tables[0]
    np.testing.assert_array_equal(cut.keys[:-2], plain.keys)
    np.testing.assert_array_equal(cut.keys[-2:], np.concatenate([closure.keys, again.keys]))


@settings(max_examples=6, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(st.integers(0, 1000), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 8.0))
def test_every_course_ends_in_the_one_map_of_the_agreed_rows(
    seed: int, loss: float, twice: float, most_s: float
) -> None:
    found = fleet(LOG, PIECES, weather=Weather(loss, twice, 0.0, most_s), seed=seed)
    assert found.settled_s is not None
    assert {bits_of(joined(m.peer.held)) for m in found.members.values()} == {offline(LOG)}
    known = found.members[2].peer.held.submaps
    has = np.concatenate([s.keys for s in known if s.robots == (2,)])
    assert np.isin(NAMED, has).all()


def test_a_closed_submap_comes_again_in_a_new_version() -> None:
    found: Fleet = fleet(LOG, PIECES)
    versions = [s.version for s in found.members[1].peer.held.submaps if s.robots == (2,)]
    assert max(versions) > 0 and len(versions) == len(split(LOG.of_robot(2), poses_per_piece=6))


def test_a_robot_that_was_killed_remembers_what_it_agreed_to(tmp_path: Path) -> None:
    with Journal(tmp_path / "journal.db", head_of(LOG, 2)) as journal:
        robot = Robot.of(LOG, 2, PIECES)
        for number, (_, tables) in enumerate(replayed(LOG, 2)):
            robot = robot.step(tables).close()
            journal.step(robot)
            if number in (3, 9):
                robot = robot.agreeing(NAMED[: number - 1])
                journal.agree(robot)
    with Journal(tmp_path / "journal.db", head_of(LOG, 2)) as journal:
        again = begun(LOG, 2, PIECES, journal.recall())
    assert np.array_equal(again.agreed, robot.agreed)
    one, two = robot.finish(), again.finish()
    assert [p.version for p in one.closed] == [p.version for p in two.closed] and one.closed[0].version > 0
    for piece in one.closed:
        for a, b in zip(one.pieces(piece.number), two.pieces(piece.number), strict=True):
            assert [t.keys.tobytes() for t in a.tables] == [t.keys.tobytes() for t in b.tables]


def test_who_comes_back_agrees_to_what_it_heard_before() -> None:
    peer = Peer(1).with_submaps(build(piece) for piece in split(LOG.of_robot(1), poses_per_piece=6))
    heard = Peer(2).recalling(content.body for content in peer.bodies.values())
    assert np.array_equal(Member(Robot.of(LOG, 2), heard, Air(Weather(), 0).link(2)).robot.agreed, NAMED)


# --- announcements -------------------------------------------------------------------------------------------------

KEYS = st.lists(
    st.one_of(st.integers(0, 400), st.builds(lambda r, t: (r << 51) + t, st.integers(1, 3), st.integers(0, 400))),
    max_size=600,
)


@settings(max_examples=50, deadline=None)
@given(KEYS, KEYS, KEYS)
def test_what_robots_know_is_a_set_that_grows(a: list[int], b: list[int], c: list[int]) -> None:
    one, two, three = (
        Knowledge().with_more(robot, np.array(keys, np.int64)) for robot, keys in enumerate((a, b, c), 1)
    )
    assert one.merge(two).merge(three).pages == three.merge(one.merge(two.merge(one))).pages
    assert one.merge(one).pages == one.pages
    more = one.merge(one.with_more(1, np.array(b, np.int64)))
    assert more.of(1) == {key for key in [*a, *b] if robot_of(key) != 1}
    assert all(page.version == len(page.keys) <= PAGE for page in more.pages.values())
    assert sum(len(page.keys) == PAGE for page in more.pages.values()) >= len(more.pages) - 1
    team_ = one.merge(two).merge(three)
    assert set(team_.beside(1).tolist()) == one_of(team_, 2) | one_of(team_, 3)
    assert set(team_.poses_of(1).tolist()) == {key for key in [*b, *c] if robot_of(key) == 1}


def one_of(known: Knowledge, robot: int) -> set[int]:
    return set(known.of(robot))


def test_what_nobody_called_by_name_is_not_told() -> None:
    assert not Knowledge().with_more(1, unnamed_key(1, np.arange(5))).pages


@settings(max_examples=50, deadline=None)
@given(KEYS)
def test_announcements_come_back_from_bytes_and_are_small(keys: list[int]) -> None:
    said = Knowledge().with_more(2, np.array(keys, np.int64))
    back = Knowledge()
    for data in announcements(said):
        back = back.merge(opened(data).told)
        assert len(data) < 60 + 8 * PAGE
    assert back.pages == said.pages


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 5000))
def test_announcements_that_make_no_sense_are_refused(noise: bytes, turn: int) -> None:
    (sound,) = announcements(Knowledge().with_more(2, np.arange(40)))
    turned = bytearray(sound)
    turned[turn % len(turned)] ^= 1 << (turn % 8)
    with pytest.raises(InputError):
        opened(bytes(turned))
    try:  # of a robot that lies
        (page,) = opened(to_bytes(Announcement(2, 0, noise).checked())).told.pages.values()
    except InputError:
        return
    assert 0 < len(page.keys) == page.version <= PAGE and min(page.keys) >= 0
