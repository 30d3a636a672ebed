"""Exact rounds between robots: they end where the full least squares does, or are given up with a reason."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.fleet import Member, fleet
from teamslam.joining import build, exact_join, split
from teamslam.joining.exact.robot import Part, separators_of
from teamslam.live import replayed
from teamslam.results.fleet import bits_of, joined, report_of
from teamslam.robot import Options, Robot
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.packets import Question
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.reduced import reduced_from, to_numbers
from teamslam.robot.rounds import Rounds, Said
from worlds import team

PIECES = Options(poses_per_piece=9)
LOG = team("2d", robots=3, poses=18, landmarks=6, sees=0.5, sigma=0.1, sigma_odometry=0.1)


def parked(habits: Habits, air: Air) -> dict[int, Member]:
    """A team whose rows have ended, and which has not talked yet."""
    members = {n: Member(Robot.of(LOG, n, PIECES), Peer(n, habits), air.link(n)) for n in (1, 2, 3)}
    for number, member in members.items():
        for _, tables in replayed(LOG, number):
            member.drive(tables)
        member.park()
    return members


def talk(air: Air, members: dict[int, Member], first: int, last: int) -> None:
    for tick in range(first, last):
        air.tick(float(tick))
        for member in members.values():
            member.talk(float(tick))


@pytest.mark.parametrize("weather", [Weather(), Weather(loss=0.3, twice=0.3, most_s=2.0)])
def test_rounds_end_at_the_full_least_squares(weather: Weather) -> None:
    found = fleet(LOG, PIECES, weather=weather, seed=3)
    best = exact_join(split(LOG, poses_per_piece=9)).map
    for member in found.members.values():
        exactness, values = member.rounds.exactness, member.rounds.values
        assert exactness is not None and values is not None
        assert exactness.relative_cost_gap < 1e-15 and exactness.gradient_norm < 1e-6 and exactness.rounds > 2
        assert exactness.join_shift_sigma > 1e-3  # the join of Gaussians was somewhere else
        keys = np.intersect1d(values.layout.keys, best.values.layout.keys)
        assert len(keys) >= 6
        np.testing.assert_allclose(values.only(keys).minus(best.values.only(keys)), 0.0, atol=1e-6)
    # The map of the set is beside it, as it was.
    assert len({bits_of(joined(member.peer.held)) for member in found.members.values()}) == 1
    record, _ = report_of(LOG, found, PIECES)
    assert record["equal_to_offline"] and record["rounds"]["exactness"]["rounds"] > 2 and not record["rounds"]["why"]
    for link in record["links"]:
        assert link["body_bytes"] + link["word_bytes"] == link["carried_bytes"]


def half_way() -> tuple[Air, dict[int, Member], int]:
    """A team in the middle of its rounds, and when that is."""
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    for tick in range(100):
        if members[1].rounds._side and members[1].rounds._side.n > 4:  # type: ignore[union-attr]
            return air, members, tick
        talk(air, members, tick, tick + 1)
    raise AssertionError("no rounds")


def test_a_robot_that_drops_out_half_way_ends_the_rounds_and_nothing_else() -> None:
    air, members, tick = half_way()
    before = bits_of(joined(members[1].peer.held))
    gone = members.pop(3)
    air.leave(3)
    talk(air, members, tick, tick + 100)
    assert members[1].rounds.exactness is None and "robot 3 did not answer" in members[1].rounds.why
    assert members[1].account["exactness"] is None and not members[1].rounds.busy
    assert {bits_of(joined(m.peer.held)) for m in members.values()} == {before}
    assert gone.peer.root == members[1].peer.root


def test_a_robot_that_comes_back_in_time_is_asked_again() -> None:
    """Killed while it answers, and started anew with what it had: the rounds begin anew, and end."""
    air, members, tick = half_way()
    old = members[3]
    again = Peer(3, old.peer.habits).recalling(content.body for content in old.peer.bodies.values())
    members[3] = Member(old.robot, again.owning(old.mapper.atlas.submaps), air.link(3), old.mapper, parked=True)
    talk(air, members, tick, tick + 100)
    assert all(member.rounds.exactness is not None for member in members.values())


def test_new_submaps_end_the_rounds_on_the_old_ones() -> None:
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    talk(air, members, 0, 60)
    assert members[2].rounds.exactness is not None
    newer = replace(members[2].peer.own[next(iter(members[2].peer.own))], version=1)
    members[2].peer = members[2].peer.with_submaps([newer])
    talk(air, members, 60, 61)
    assert members[2].rounds.exactness is None
    talk(air, members, 61, 140)
    assert all(member.rounds.exactness is not None for member in members.values())


def test_where_links_are_tight_there_are_none_and_it_is_said() -> None:
    for habits in (Habits(budget=1e6), Habits(rate=30.0)):
        air = Air(Weather(), 0)
        members = parked(habits, air)
        talk(air, members, 0, 400)
        assert members[1].rounds.why == "the links are too tight" and members[1].rounds.exactness is None
    air = Air(Weather(), 0)
    members = parked(Habits(), air)
    alone = {1: replace(members[1], peer=Peer(1).with_submaps(members[1].peer.own.values()))}
    talk(air, alone, 0, 3)
    assert alone[1].rounds.why == "one robot alone"


def test_only_the_lowest_robot_is_answered_and_what_makes_no_sense_is_not() -> None:
    air = Air(Weather(), 0)
    members = parked(Habits(), air)
    talk(air, members, 0, 60)
    robot, peer = members[3].robot, members[3].peer
    reduce = msgspec.msgpack.encode(Said("reduce"))
    for sender, root, data in ((2, peer.root, reduce), (1, bytes(16), reduce), (1, peer.root, b"no question")):
        rounds = Rounds()
        assert rounds.attend(0.0, peer, robot, [(sender, Question(root, 9, 0, data))], True) == []
        assert rounds.exactness is None
    assert Rounds().attend(0.0, peer, robot, [(1, Question(peer.root, 9, 0, reduce))], True)


def test_answers_come_back_from_bytes_to_the_bit() -> None:
    pieces = split(LOG, poses_per_piece=9)
    submaps = [build(piece) for piece in pieces]
    for keys in (separators_of(submaps, []), submaps[0].values.layout.keys):
        part = Part(pieces[0], submaps[0], keys)
        found = part.reduce()
        back = reduced_from(to_numbers(found), part.sending)
        assert (back.information != found.information).nnz == 0 and back.cost == found.cost
        np.testing.assert_array_equal(back.slope, found.slope)
    other = Part(pieces[1], submaps[1], separators_of(submaps, []))
    with pytest.raises(InputError, match="another size"):
        reduced_from(to_numbers(found), other.sending)
