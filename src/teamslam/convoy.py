"""A robot in a process of its own among others: it drives in real time, talks over a network, and keeps a journal.

    rows at their time ─ step ─ close ─ map ─┐
    packets ─────────────────────────────────┴─ journal ─ peer ─ packets

What others are told is on the disk before. When its rows have ended it goes on talking until it is told to leave.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import monotonic, sleep
from typing import Any

from teamslam.fleet import Member
from teamslam.given_back import give_back
from teamslam.model import Names, Table
from teamslam.robot.journal import Journal
from teamslam.robot.line import Line
from teamslam.robot.peer import EVERYONE

BEAT_S = 0.02  # between two looks at the link
STATUS_S = 0.5  # between two reports
TIDY_S = 30.0  # between two times that free memory is given back, while it stands
HEARD_AT_ONCE = 4  # packets: no flood of them makes a row wait for long


@dataclass
class Driver:
    """A member of a team with its journal; `report` is called now and then, `leave` says when it is to end, `names`
    what everybody is called by now, where rows bring new names."""

    member: Member
    journal: Journal
    report: Callable[["Driver"], None] = lambda driver: None
    leave: Callable[[], bool] = lambda: False
    names: Callable[[], Names] | None = None
    parked: bool = False
    kept: set[bytes] = field(default_factory=set)
    may_be_lost: bool = False
    reported_s: float = -1e300
    tidied_s: float = -1e300

    def drive(self, arrivals: Iterable[tuple[float, list[Table]]], speed: float | None) -> bool:
        """All rows at their time (at once where `speed` is None; without rows it only listens), and on until it is to
        leave. False where it left before its rows had ended."""
        began, first = monotonic(), None
        for stamp, tables in arrivals:
            first = stamp if first is None else first
            due = began + (stamp - first) / speed if speed is not None else began
            self.beat()
            while monotonic() < due and not self.leave():
                sleep(min(BEAT_S, max(0.0, due - monotonic())))
                self.beat()
            if self.leave():
                return False
            if not tables:
                continue
            if self.names is not None:
                self.member.robot = self.member.robot.calling(self.names())
            self.member.drive(tables)
            self.journal.step(self.member.robot)
        self.member.park()
        self.parked = True
        while not self.leave():
            self.beat()
            self._tidy()
            sleep(BEAT_S)
        self.member.round_off()
        self.beat()
        return True

    def beat(self) -> None:
        """Hear, write down, say: of what it made itself nothing before it is on the disk."""
        self._keep()
        self.member.talk(monotonic(), self._keep, HEARD_AT_ONCE)
        if monotonic() - self.reported_s >= STATUS_S or self.leave():
            self.reported_s = monotonic()
            self.report(self)

    def _tidy(self) -> None:
        """Where no step waits for it, what joins and rounds have freed goes back to the system."""
        if monotonic() - self.tidied_s >= TIDY_S:
            self.tidied_s = monotonic()
            give_back()

    def _keep(self) -> bool:
        """Write down what is new. Whether anything may be said: what it made and could lose again, nobody hears of."""
        self.journal.agree(self.member.robot)
        bodies, number = self.member.peer.bodies, self.member.robot.number
        fresh = [digest for digest in bodies if digest not in self.kept]
        written = self.journal.bodies(bodies[digest].body for digest in fresh)
        self.kept.update(fresh)
        own = any(bodies[d].opened.base == number and not bodies[d].entry.knows for d in fresh)
        self.may_be_lost = not written and (own or self.may_be_lost)
        self.member.scribe.waits = not written
        return not self.may_be_lost

    def status(self, names: Names) -> dict[str, Any]:
        """How it stands, for people and for whoever watches it."""
        peer, robot = self.member.peer, self.member.robot
        now, now_s = robot.now, monotonic()
        return {
            "robot": names.robot(robot.number),
            "parked": self.parked,
            "ended": self.leave(),
            "alive": [names.robot(number) for number in sorted(self.member.link.alive)],
            "making": self.member.busy,
            "rounds": {"busy": self.member.rounds.busy, "parts": self.member.accounts},
            "at": names.describe(now.key) if now is not None else None,
            "rows": {"taken": robot.counts.taken, "repeated": robot.counts.repeated, "late": robot.counts.late},
            "holds": [f"{entry.id}, version {entry.version}" for entry in peer.listing.entries if not entry.knows],
            "in_short": peer.in_short,
            "root": peer.root.hex(),
            "missing": len(peer.missing),
            "left_out": peer.left_out,
            "agreed": len(robot.agreed),
            "revoked": [names.robot(number) for number in sorted(robot.head.robots) if peer.revoked(number)],
            "refused_packets": dict(peer.refused),
            "journal": self.journal.trouble,
            "map": self.member.mapper.trouble,
            "links": {
                "all" if to == EVERYONE else names.robot(to): _line(line, now_s)
                for to, line in sorted(peer.lines.items())
            },
        }


def _line(line: Line, now_s: float) -> dict[str, Any]:
    """What a line to another robot has carried, how many bodies wait for their turn on it, and how long ago [s] that
    robot was heard (None: not yet)."""
    ago_s = now_s - line.heard_s
    heard = {"heard_s_ago": round(ago_s, 1) if ago_s < 1e9 else None}
    return line.sent.record() | {"refused": line.refused, "waiting": len(line.waiting)} | heard
