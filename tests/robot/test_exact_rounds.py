"""Exact rounds between robots: they end where the full least squares does, or are given up with a reason."""

import gc
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from teamslam.cli.convoy import written_anew
from teamslam.errors import InputError
from teamslam.fleet import Member, fleet
from teamslam.io import read_submaps
from teamslam.joining import build, exact_join, join, split
from teamslam.joining.exact.robot import Part, Sending, separators_of
from teamslam.live import replayed
from teamslam.model import Dataset, Table, Values, is_landmark, is_pose, robot_of
from teamslam.results.fleet import bits_of, joined, report_of
from teamslam.robot import Options, Robot
from teamslam.robot.exchange import step
from teamslam.robot.forms import made
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.packets import Question, to_bytes
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.reduced import reduced_from, to_numbers
from teamslam.robot.rounds import Account, Rounds
from teamslam.robot.rounds.leader import Leader
from teamslam.robot.rounds.said import Said
from teamslam.solver import Factor, SubmapTerm, System, optimise
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


def account(member: Member) -> Account:
    """What rounds came to on the first part of the map."""
    return member.rounds.accounts[0]


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
        exactness, values = account(member).exactness, member.rounds.courses[0].values  # type: ignore[index]
        assert exactness is not None and values is not None
        assert exactness.relative_cost_gap < 1e-15 and exactness.gradient_norm < 1e-6 and exactness.rounds > 2
        assert exactness.join_shift_sigma > 1e-3  # the join of Gaussians was somewhere else
        keys = np.intersect1d(values.layout.keys, best.values.layout.keys)
        assert len(keys) >= 6
        np.testing.assert_allclose(values.only(keys).minus(best.values.only(keys)), 0.0, atol=1e-6)
    # The map of the set is beside it, as it was.
    assert len({bits_of(joined(member.peer.held)) for member in found.members.values()}) == 1
    record, _ = report_of(LOG, found, PIECES)
    assert (
        record["equal_to_offline"] and record["rounds"][0]["exactness"]["rounds"] > 2 and not record["rounds"][0]["why"]
    )
    for link in record["links"]:
        assert link["body_bytes"] + link["word_bytes"] == link["carried_bytes"]


class Slow(Executor):
    """One thread, which is done with nothing before it is let go on."""

    def __init__(self) -> None:
        self.orders = list[tuple[Future[Any], Callable[[], Any]]]()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        self.orders.append((future := Future(), partial(fn, *args)))
        return future

    def go_on(self) -> None:
        for future, call in self.orders:
            future.set_result(call())
        self.orders.clear()


@pytest.mark.parametrize("slow", [1, 2, 3])
def test_while_rounds_are_at_work_a_robot_hears_and_speaks(slow: int) -> None:
    """Each turn of one robot's rounds takes four seconds, of a patience of one. It tells what it holds meanwhile and
    gives what it is asked for, nobody takes it to be away, and all end where the full least squares does."""
    air, thread = Air(Weather(), 0), Slow()
    members = parked(Habits(patience_s=1.0), air)
    members[slow].rounds = Rounds(thread)
    for tick in range(300):
        talk(air, members, tick, tick + 1)
        assert not thread.orders or members[slow].rounds.busy
        if tick % 4 == 3:
            thread.go_on()
        heard_s = [
            other.peer.lines[slow].heard_s for n, other in members.items() if n != slow and slow in other.peer.lines
        ]
        assert all(tick - s <= 2.0 for s in heard_s)
    best = exact_join(split(LOG, poses_per_piece=9)).map.all_values
    for member in members.values():
        found = member.rounds.courses[0].values  # type: ignore[index]
        assert found is not None and account(member).as_sent == () and not member.rounds._more
        keys = np.intersect1d(found.layout.keys, best.layout.keys)
        np.testing.assert_allclose(found.only(keys).minus(best.only(keys)), 0.0, atol=1e-6)


def half_way() -> tuple[Air, dict[int, Member], int]:
    """A team in the middle of its rounds, and when that is."""
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    for tick in range(100):
        for course in members[1].rounds.courses or ():
            if isinstance(course._side, Leader) and course._side.n > 4:
                return air, members, tick
        talk(air, members, tick, tick + 1)
    raise AssertionError("no rounds")


@pytest.mark.parametrize("gone", [1, 2, 3])
def test_a_robot_that_drops_out_half_way_stays_as_it_was_sent(gone: int) -> None:
    """Whoever it is, the one who asks among them: the others begin anew without its rows, and its submaps stand as the
    Gaussians that they are. When it comes back, all rows count again."""
    air, members, tick = half_way()
    before = bits_of(joined(members[1].peer.held))
    lost = members.pop(gone)
    air.leave(gone)
    talk(air, members, tick, tick + 150)
    for member in members.values():
        assert account(member).as_sent == (gone,) and not account(member).why and not member.rounds.busy
    values = [member.rounds.courses[0].values for member in members.values()]  # type: ignore[index]
    np.testing.assert_allclose(values[0].minus(values[1]), 0.0, atol=1e-12)  # type: ignore[union-attr]
    # Law: it is the least of what the others measured, and of what was sent.
    best = _with_one_as_sent(gone)
    keys = np.intersect1d(values[0].layout.keys, best.layout.keys)  # type: ignore[union-attr]
    assert len(keys) >= 6
    np.testing.assert_allclose(values[0].only(keys).minus(best.only(keys)), 0.0, atol=1e-6)  # type: ignore[union-attr]
    assert {bits_of(joined(m.peer.held)) for m in members.values()} == {before}
    members[gone] = replace(lost, link=air.link(gone))
    talk(air, members, tick + 150, tick + 300)
    full = exact_join(split(LOG, poses_per_piece=9)).map
    for member in members.values():
        assert account(member).as_sent == () and account(member).exactness is not None
        found = member.rounds.courses[0].values  # type: ignore[index]
        assert found is not None
        np.testing.assert_allclose(found.only(keys).minus(full.all_values.only(keys)), 0.0, atol=1e-6)


def _with_one_as_sent(gone: int) -> Values:
    """The least squares of all rows of the others, and of the Gaussians of one robot's submaps."""
    pieces = split(LOG, poses_per_piece=9)
    sent = [build(piece) for piece in pieces if piece.tables[0].robot == gone]
    rows = [table for piece in pieces if piece.tables[0].robot != gone for table in piece.tables]
    start = join(build(piece) for piece in pieces).map
    system = System(
        start.all_values.layout, tables=rows, submaps=[SubmapTerm.of(s) for s in sent], fixed=np.array([start.base])
    )
    return optimise(system, start.all_values).values


def test_a_robot_that_never_answers_though_it_is_there_is_named() -> None:
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    members[3].rounds.attend = lambda *_: []  # type: ignore[method-assign]
    talk(air, members, 0, 100)
    found = account(members[1])
    assert found.exactness is None and found.why.startswith("robot 3 did not answer question 0")
    assert not members[1].rounds.busy


def test_a_robot_that_answers_at_last_is_asked_again_after_a_rest() -> None:
    """Links that were torn for long are no reason to have no exact map for ever; and rests grow, so that nobody is
    asked all the time."""
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    mute = members[3].rounds.attend
    members[3].rounds.attend = lambda *_: []  # type: ignore[method-assign]
    asked = []
    for tick in range(300):
        talk(air, members, tick, tick + 1)
        if members[1].rounds.busy and members[1].rounds.accounts:
            asked.append(tick)
    first, second = (step for step in np.diff(asked) if step > 1)
    assert second > 1.9 * first > 60.0
    members[3].rounds.attend = mute  # type: ignore[method-assign]
    talk(air, members, 300, 500)
    assert all(account(member).exactness is not None and not account(member).why for member in members.values())


@pytest.mark.parametrize("rate", [4000.0, 1000.0])
def test_what_is_slow_is_not_sent_again_and_again(rate: float) -> None:
    """An answer takes about a patience on these lines, or three. Asked for again each patience they would carry little
    but copies, and more come than go; as it is the rounds end, and about two answers in three are news."""
    air, tick = Air(Weather(), 0), 0
    members = parked(Habits(patience_s=1.0), air)
    while not leads(members[1]):
        talk(air, members, tick, tick := tick + 1)
    air.weather, before = Weather(rate=rate), {n: members[n].peer.lines[1].sent.words for n in (2, 3)}
    talk(air, members, tick, tick + 700)
    for n in (2, 3):
        found = account(members[n]).exactness
        assert found is not None and not account(members[n]).as_sent
        if rate == 4000.0:  # of each round two questions, and the last
            assert members[n].peer.lines[1].sent.words - before[n] <= 1.5 * (2 * found.rounds + 1)


def test_who_is_known_to_be_away_is_not_waited_for_again() -> None:
    """Nobody has heard of the third for long: on all that is new the others begin at once. A robot that has just begun
    to listen does not know yet who is there."""
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    talk(air, members, 0, 60)
    del members[3]
    air.leave(3)
    talk(air, members, 60, 75)
    newer = replace(members[2].peer.own[next(iter(members[2].peer.own))], version=1)
    members[2].peer = members[2].peer.with_submaps([newer])
    talk(air, members, 75, 82)
    assert leads(members[1]) and not leads(members[2])
    members[1].rounds = Rounds()
    talk(air, members, 82, 90)
    assert not leads(members[1]) and members[1].rounds.busy
    talk(air, members, 90, 160)
    assert account(members[1]).as_sent == account(members[2]).as_sent == (3,)


def leads(member: Member) -> bool:
    """Whether a robot asks others just now."""
    return any(isinstance(course._side, Leader) for course in member.rounds.courses or ())


def test_while_something_is_lacked_that_may_come_there_are_none() -> None:
    """A list says what is held elsewhere, and bodies do not come for a while: no map is made of half a set. Where they
    do not come at all, there are rounds of what there is."""
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    whole = members[3].peer
    lacked = Peer(3, whole.habits).owning(list(whole.own.values())[:1])
    members[3].peer = lacked.with_messages(made(lacked.orders))
    talk(air, members, 0, 4)
    for robot in (1, 2):
        members[robot].peer, _ = step(members[robot].peer, 4.0, [(3, to_bytes(whole.listing))])
        assert members[robot].peer.missing
    del members[3]
    air.leave(3)
    talk(air, members, 4, 12)
    assert not any(member.rounds.courses for member in members.values())
    talk(air, members, 12, 90)
    assert members[1].peer.missing and all(account(member).exactness is not None for member in members.values())


def test_parts_that_nothing_ties_together_have_rounds_of_their_own() -> None:
    """Each is led by its own lowest robot, and ends at its own full least squares."""
    apart = replace(LOG, tables=tuple(_apart(LOG)))
    found = fleet(apart, PIECES)
    record, made = report_of(apart, found, PIECES)
    assert made is not None and len(made.components) > 1
    assert [part["robots"] for part in record["rounds"]] == [["1"], ["2", "3"]]
    assert record["rounds"][0]["why"] == "one robot alone" and record["rounds"][1]["exactness"]["rounds"] > 2
    best = exact_join(split(apart, poses_per_piece=9)).components[1].map
    (map_,) = found.members[3].rounds.maps
    np.testing.assert_allclose(
        map_.all_values.only(best.landmark_keys).minus(best.all_values.only(best.landmark_keys)), 0.0, atol=1e-6
    )


def _apart(log: Dataset) -> Iterator[Table]:
    """Without whatever ties robot 1 to the others."""
    for table in log.tables:
        other = is_pose(table.keys) & (robot_of(table.keys) != table.robot)
        ties = other & ((table.robot == 1) | (robot_of(table.keys) == 1))
        keys = np.where(is_landmark(table.keys) & (table.robot == 1), table.keys + 100, table.keys)
        yield replace(table, keys=keys).select(~ties.any(-1))


def test_the_map_of_rounds_holds_all_and_is_the_full_least_squares() -> None:
    """A robot's own poses, and all landmarks; the poses of others are where their submaps put them then."""
    found = fleet(LOG, PIECES)
    best = exact_join(split(LOG, poses_per_piece=9)).map
    for number, member in found.members.items():
        (map_,) = member.rounds.maps
        np.testing.assert_array_equal(np.sort(map_.keys), np.sort(best.keys))
        own = np.concatenate([map_.landmark_keys, map_.trajectory_keys(number)])
        np.testing.assert_allclose(map_.all_values.only(own).minus(best.all_values.only(own)), 0.0, atol=1e-6)
        assert map_.cost == pytest.approx(best.cost)
        assert np.abs(map_.all_values.minus(best.all_values)).max() < 0.05


def test_a_robot_that_comes_back_in_time_is_asked_again() -> None:
    """Killed while it answers, and started anew with what it had: the rounds begin anew, and end."""
    air, members, tick = half_way()
    old = members[3]
    again = Peer(3, old.peer.habits).recalling(content.body for content in old.peer.bodies.values())
    members[3] = Member(old.robot, again.owning(old.mapper.atlas.submaps), air.link(3), old.mapper, parked=True)
    talk(air, members, tick, tick + 100)
    assert all(account(member).exactness is not None for member in members.values())


def test_new_submaps_end_the_rounds_on_the_old_ones() -> None:
    air = Air(Weather(), 0)
    members = parked(Habits(patience_s=1.0), air)
    talk(air, members, 0, 60)
    assert account(members[2]).exactness is not None
    newer = replace(members[2].peer.own[next(iter(members[2].peer.own))], version=1)
    members[2].peer = members[2].peer.with_submaps([newer])
    talk(air, members, 60, 61)
    assert not members[2].rounds.accounts
    talk(air, members, 61, 140)
    assert all(account(member).exactness is not None for member in members.values())


def test_a_team_that_stands_holds_no_more_however_often_rounds_begin_anew() -> None:
    """Law: once rounds have ended, nothing of what they worked with is left; and where they are made again, of a newer
    submap, without a robot that is away and with it once it is back, as much is held as before."""
    air = Air(Weather(), 0)
    members, now = parked(Habits(patience_s=1.0), air), 0
    gc.collect()
    before = held_of(Part, Factor, Leader)
    talk(air, members, now, now := now + 60)
    held: list[tuple[int, int]] = []
    tracemalloc.start()
    for version, gone in enumerate((3, 1, 3), 1):
        lost = members.pop(gone)
        air.leave(gone)
        talk(air, members, now, now := now + 12)
        newer = replace(members[2].peer.own[next(iter(members[2].peer.own))], version=version)
        members[2].peer = members[2].peer.with_submaps([newer])
        talk(air, members, now, now := now + 90)
        assert account(members[2]).as_sent == (gone,)
        members[gone] = replace(lost, link=air.link(gone))
        talk(air, members, now, now := now + 70)
        assert all(account(member).as_sent == () and not member.rounds.busy for member in members.values())
        gc.collect()
        assert held_of(Part, Factor, Leader) == before
        held.append((len(gc.get_objects()), tracemalloc.get_traced_memory()[0]))
    tracemalloc.stop()
    (objects, size), (objects_then, size_then) = held[-2:]
    assert objects_then - objects < 100 and size_then - size < 30_000  # `opened` remembers the newer submap's 2 kB


def held_of(*kinds: type) -> int:
    """How many objects of some kinds are alive."""
    return sum(isinstance(each, kinds) for each in gc.get_objects())


def test_where_links_are_tight_there_are_none_and_it_is_said() -> None:
    for habits in (Habits(budget=1e6), Habits(rate=30.0)):
        air = Air(Weather(), 0)
        members = parked(habits, air)
        talk(air, members, 0, 400)
        assert account(members[1]).why == "the links are too tight" and account(members[1]).exactness is None
    air = Air(Weather(), 0)
    members = parked(Habits(), air)
    alone = {1: replace(members[1], peer=Peer(1).with_submaps(members[1].peer.own.values()))}
    talk(air, alone, 0, 8)
    assert account(alone[1]).why == "one robot alone"


def test_only_the_lowest_robot_is_answered_and_what_makes_no_sense_is_not() -> None:
    air = Air(Weather(), 0)
    members = parked(Habits(), air)
    talk(air, members, 0, 60)
    robot, peer = members[3].robot, members[3].peer
    reduce = msgspec.msgpack.encode(Said("reduce"))
    for sender, root, data in ((2, peer.root, reduce), (1, bytes(16), reduce), (1, peer.root, b"no question")):
        rounds = Rounds()
        assert rounds.attend(0.0, peer, robot, [(sender, Question(root, 0, 9, 0, data))], True) == []
        assert all(found.exactness is None for found in rounds.accounts)
    assert Rounds().attend(0.0, peer, robot, [(1, Question(peer.root, 0, 9, 0, reduce))], True)


def test_maps_of_an_earlier_time_do_not_stay_beside_those_of_now(tmp_path: Path) -> None:
    """A robot that was ended and goes on ends with another map, of another name."""
    earlier, later = ([build(piece)] for piece in split(LOG, poses_per_piece=9)[:2])
    for parts in (earlier, later):
        written_anew(parts, tmp_path / "maps")
    assert [submap.id for submap in read_submaps(tmp_path / "maps")] == [later[0].id]
    written_anew([], tmp_path / "maps")
    assert not (tmp_path / "maps").exists()


def test_answers_come_back_from_bytes_to_the_bit() -> None:
    pieces = split(LOG, poses_per_piece=9)
    submaps = [build(piece) for piece in pieces]
    for keys in (separators_of(submaps, []), submaps[0].values.layout.keys):
        part = Part.of(pieces[0], submaps[0], Sending.of(submaps[0], keys))
        found = part.reduce()
        back = reduced_from(to_numbers(found), part.sending)
        assert (back.information != found.information).nnz == 0 and back.cost == found.cost
        np.testing.assert_array_equal(back.slope, found.slope)
    other = Part.of(pieces[1], submaps[1], Sending.of(submaps[1], separators_of(submaps, [])))
    with pytest.raises(InputError, match="another size"):
        reduced_from(to_numbers(found), other.sending)
