"""A whole team on one machine, from a log: each robot drives, closes submaps and exchanges them over links in memory.

    rows of all robots in time order ─ step ─ close ─ map ─┐
    packets over lines that lose, delay and repeat ────────┴─ peers ─ one set, one map

Time is that of the log; it goes on after the last row until all hold the same and exact rounds have ended, or for
`settle_s`.
"""

import heapq
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from teamslam.live import Mapper, replayed
from teamslam.model import Dataset, Submap, Table
from teamslam.robot import Estimate, Options, Robot
from teamslam.robot.exchange import saying, step
from teamslam.robot.link import HEARD, Link
from teamslam.robot.link.memory import Air, Weather, always
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.rounds import Rounds
from teamslam.robot.scribe import Scribe

TURNS = 4  # of each peer between two announcements


@dataclass
class Member:
    """One robot of the team: its log so far, its maps, what it knows of others, its end of the link, and the poses that
    it told at the time."""

    robot: Robot
    peer: Peer
    link: Link
    mapper: Mapper = field(default_factory=Mapper)
    scribe: Scribe = field(default_factory=Scribe)
    rounds: Rounds = field(default_factory=Rounds)
    told: list[Estimate] = field(default_factory=list)
    parked: bool = False

    def __post_init__(self) -> None:
        self.agree()

    def drive(self, tables: list[Table]) -> None:
        """Some rows more."""
        self.robot = self.robot.step(tables)
        if self.robot.due:
            self.robot = self.robot.close()
        self._attend()
        if (now := self.robot.now) is not None:
            self.told.append(now)

    def park(self) -> None:
        """No rows will come any more."""
        self.robot = self.robot.finish()
        self.peer = self.scribe.attend(self.peer.owning(self.mapper.finish(self.robot)))
        self.parked = True

    def round_off(self) -> None:
        """Before it leaves: messages that are still to be made are made at once."""
        self.scribe = Scribe()
        self.peer = self.scribe.attend(self.peer)

    def talk(self, now_s: float, between: Callable[[], bool] = lambda: True, most: int = HEARD) -> None:
        """Hear (at most so many packets) and say what there is; `between` the two something may be done, which tells
        whether anything may be said."""
        known = self.peer.known
        self.peer, out = step(self.peer, now_s, self.link.receive(most))
        if self.peer.known is not known:
            self.agree()
        if self.parked:
            self._attend()
        self.peer = self.scribe.attend(self.peer)
        ready = self.parked and not self.busy
        said = self.rounds.attend(now_s, self.peer, self.robot, self.peer.asides, ready)
        self.peer, more = saying(self.peer, said)
        out += more
        for packet in out if between() else ():
            self.link.send(packet.to, packet.data)

    def agree(self) -> None:
        """Have a pose wherever others say that they saw it."""
        self.robot = self.robot.agreeing(self.peer.known.poses_of(self.robot.number))

    def _attend(self) -> None:
        self.robot, finished = self.mapper.attend(self.robot, self.others)
        if finished:
            self.peer = self.scribe.attend(self.peer.owning(finished))

    @property
    def busy(self) -> bool:
        """Whether something is not yet made of what it has."""
        return self.mapper.busy(self.robot) or self.scribe.busy(self.peer)

    @property
    def accounts(self) -> list[dict[str, Any]]:
        """What exact rounds came to, part by part of the map: whose it is, their `exactness` (None: there is none),
        `why` there is none, and whose submaps stood `as_sent`."""
        name = self.robot.head.names.robot
        return [
            asdict(found) | {"robots": list(map(name, found.robots)), "as_sent": list(map(name, found.as_sent))}
            for found in self.rounds.accounts
        ]

    def others(self) -> tuple[Submap, ...]:
        """What it has heard."""
        return self.peer.held.submaps


@dataclass(frozen=True, eq=False)
class Fleet:
    """What came of it: the members by their number, the bytes carried by line, and how long after the last row [s] all
    held the same (None: not within the time given)."""

    members: Mapping[int, Member]
    carried: Mapping[tuple[int, int], int]
    settled_s: float | None


def fleet(
    log: Dataset,
    options: Options | None = None,
    *,
    habits: Habits | None = None,
    weather: Weather | None = None,
    seed: int = 0,
    settle_s: float = 600.0,
    progress: Callable[[float], None] | None = None,
) -> Fleet:
    """The robots of a log as if they drove now, each knowing its own rows and what it hears.

    Law: where all end up holding the same, their maps are equal to the bit, and are that of the submaps of `split` and
    `build`.
    """
    habits, air = habits or Habits(), Air(weather or Weather(), seed, always)
    numbers = [robot for robot in sorted(log.robots) if log.of_robot(robot).tables]
    members = {n: Member(Robot.of(log, n, options), Peer(n, habits), air.link(n)) for n in numbers}
    turn_s = habits.announce_s / TURNS
    now_s: float | None = None
    rows = heapq.merge(*(_rows(log, number) for number in numbers), key=lambda row: row[:2])
    for stamp, number, tables in rows:
        now_s = stamp if now_s is None else now_s
        while now_s + turn_s <= stamp:
            now_s += turn_s
            _turn(air, members, now_s)
        members[number].drive(tables)
        if progress is not None:
            progress(stamp)
    for member in members.values():
        member.park()
    end_s = now_s = now_s or 0.0
    settled_s: float | None = 0.0 if _settled(members) else None
    while (settled_s is None or _in_rounds(members)) and now_s - end_s < settle_s:
        now_s += turn_s
        _turn(air, members, now_s)
        settled_s = now_s - end_s if settled_s is None and _settled(members) else settled_s
    return Fleet(members, dict(air.carried), settled_s)


def _settled(members: Mapping[int, Member]) -> bool:
    """Whether all hold the same, and nobody has anything more to say."""
    same = len({member.peer.root for member in members.values()}) <= 1
    return same and not any(member.busy for member in members.values())


def _in_rounds(members: Mapping[int, Member]) -> bool:
    """Whether exact rounds go on, or may begin yet."""
    return len(members) > 1 and any(
        member.rounds.busy or member.rounds.root != member.peer.root for member in members.values()
    )


def _rows(log: Dataset, number: int) -> Iterator[tuple[float, int, list[Table]]]:
    for stamp, tables in replayed(log, number):
        yield stamp, number, tables


def _turn(air: Air, members: Mapping[int, Member], now_s: float) -> None:
    air.tick(now_s)
    for member in members.values():
        member.talk(now_s)
