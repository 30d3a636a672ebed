"""Exact rounds on one part of the map: who leads, who is away, and when they begin anew or are given up.

Of the robots whose submaps are in the part, those that were heard lately are here, and the lowest of these asks. The
submaps of those that are away stay what they sent; when one of these comes back, the rounds begin anew with it. Who is
away is known once a robot has listened for long; for what it hears of later nobody is waited for again.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec

from teamslam.errors import TeamslamError
from teamslam.joining import Component, Exactness
from teamslam.model import Submap, Values
from teamslam.robot.packets import Answer, Packet, Question
from teamslam.robot.peer import Peer
from teamslam.robot.robot import Robot
from teamslam.robot.rounds.follower import Follower
from teamslam.robot.rounds.leader import Leader
from teamslam.robot.rounds.pace import longest_s, slower_s
from teamslam.robot.rounds.result import Result
from teamslam.robot.rounds.said import exactness_of
from teamslam.robot.rounds.stage import Stage, robots_of

ATTEMPTS, LONG = 3, 10  # of rounds, one after another; waits for an answer, or patiences
RESTS = 4  # such waits before one attempt more, and twice as long after each

Heard = Sequence[tuple[int, Packet]]
Out = list[tuple[int, Packet]]


@dataclass(frozen=True)
class Account:
    """What rounds came to on one part of the map, which is of these `robots`: their `exactness` (None: there is none,
    or none yet), `why` there is none, and whose submaps stood `as_sent`, because these robots were away."""

    robots: tuple[int, ...]
    exactness: Exactness | None
    why: str
    as_sent: tuple[int, ...] = ()


class Course:
    """A robot's side of rounds on part `number` of the map that the set `root` gives; it has listened to others since
    `first_s`. `busy`: there may be a result yet."""

    def __init__(
        self, root: bytes, number: int, component: Component, by_id: Mapping[str, Submap], now_s: float, first_s: float
    ) -> None:
        self.root, self.number, self.robots = root, number, robots_of(component, by_id)
        self._component, self._by_id, self._since_s, self._first_s = component, by_id, now_s, first_s
        self._side: Leader | Follower | None = None
        self._attempt = self._tries = 0
        self._rests_until_s = -1e300
        self._result: Result | None = None
        self.why, self.busy, self._given_up = "", False, False

    @property
    def account(self) -> Account:
        """What it came to so far."""
        end = self._result.end if self._result is not None else None
        exactness = exactness_of(end) if end is not None else None
        return Account(tuple(self.robots), exactness, self.why, end.as_sent if end is not None else ())

    @property
    def values(self) -> Values | None:
        """Where separators are (landmarks, poses that several submaps share), once rounds have ended."""
        return self._result.values if self._result is not None else None

    @property
    def map(self) -> Submap | None:
        """The part where rounds have put it, once they have ended (`Stage.map_at`)."""
        found = self._result
        return None if found is None else self._stage().map_at(found.values, found.interiors, found.end.cost)

    def attend(self, now_s: float, peer: Peer, robot: Robot, heard: Heard) -> Out:
        """Questions and answers to be sent, after those of this part that were `heard`."""
        long_s = LONG * peer.habits.patience_s
        away = {n for n in self.robots if n != peer.number and now_s - _heard_s(peer, n) > long_s}
        here = [n for n in self.robots if n not in away]
        try:
            if here[:1] == [peer.number]:
                return self._lead(now_s, peer, robot, heard, here[1:])
            self.busy = False
            if isinstance(self._side, Leader):  # who goes before it is back
                self._side = None
            if peer.number not in self.robots:
                return []
            asked = [(s, q) for s, q in heard if isinstance(q, Question) and here[:1] == [s]]
            out = [out for sender, question in asked for out in self._follow(now_s, robot, sender, question)]
            most_s = longest_s(long_s)
            if isinstance(self._side, Follower) and now_s - self._side.asked_s > most_s:  # nobody waits for it any more
                self._side = None
            return out
        except (TeamslamError, msgspec.DecodeError, ValueError, zlib.error) as error:
            return self._give_up(str(error))

    def _stage(self) -> Stage:
        return Stage.of(self._component, self._by_id)

    def _follow(self, now_s: float, robot: Robot, sender: int, asked: Question) -> Out:
        side = self._side
        if isinstance(side, Follower) and side.leader == sender and asked.attempt < side.attempt:
            # Its leader began anew, and does not know what it asked before.
            return [(sender, Answer(self.root, self.number, side.attempt, 0, b""))]
        if not isinstance(side, Follower) or side.leader != sender or asked.attempt > side.attempt:
            stage = self._stage()
            side = self._side = Follower(stage, stage.parts(robot), sender, asked.attempt)
        self._attempt = max(self._attempt, asked.attempt)
        answer = side.answer(asked.n, asked.data)
        side.asked_s = now_s
        self._result = side.result or self._result
        return [] if answer is None else [(sender, Answer(self.root, self.number, asked.attempt, asked.n, answer))]

    def _lead(self, now_s: float, peer: Peer, robot: Robot, heard: Heard, others: Sequence[int]) -> Out:
        back = self._result is None or not set(self._result.end.as_sent).isdisjoint(others)
        if self._given_up or not back or now_s < self._rests_until_s:
            self.busy = False
            return []
        self.busy = True
        if not isinstance(self._side, Leader):
            return self._begin(now_s, peer, robot, others)
        side, before = self._side, self._side.n
        answers = [(s, p) for s, p in heard if isinstance(p, Answer) and s in side.others]
        for sender, packet in answers:
            if packet.attempt == side.attempt:
                side.hear(now_s, sender, packet.n, packet.data)
        side.attend(now_s)
        if side.result is not None:
            self._result, self._side, self._tries, self.busy = side.result, None, 0, False
            return []
        if (newest := max((p.attempt for _, p in answers), default=0)) > side.attempt:  # asked before it was killed
            self._attempt = newest
            return self._anew(now_s, peer, f"robot {answers[0][0]} knows of a later attempt")
        if side.n != before:
            return self._asking(side, side.others)
        patience_s, asked_s = slower_s(peer.habits.patience_s, self._tries - 1), now_s - side.asked_s
        waits_s = {n: side.wait_s(n, patience_s) if n in others else patience_s for n in side.silent}
        if late := [n for n, wait_s in waits_s.items() if asked_s > LONG * wait_s]:
            return self._anew(now_s, peer, f"robot {late[0]} did not answer question {side.n}")
        return self._asking(side, side.again(now_s, patience_s))

    def _begin(self, now_s: float, peer: Peer, robot: Robot, others: Sequence[int]) -> Out:
        if len(self.robots) == 1:
            return self._give_up("one robot alone")
        if peer.in_short or peer.habits.budget is not None:
            return self._give_up("the links are too tight")
        long_s = LONG * peer.habits.patience_s
        waited, listened = now_s - self._since_s > long_s, now_s - self._first_s > long_s
        away = [n for n in self.robots if n != peer.number and n not in others]
        if away and not listened:  # who was not heard yet may be there
            return []
        if elsewhere := [n for n in others if peer.lines[n].root != self.root]:
            if waited:  # it may come to hold the same yet, as one does that is back
                self.why, self.busy = f"robot {elsewhere[0]} holds something else", False
            return []
        self.why = ""
        stage = self._stage()
        if not stage.light(peer.habits.rate):
            return self._give_up("the links are too tight")
        self._attempt += 1
        self._tries += 1
        self._side = side = Leader(stage, stage.parts(robot), others, away, self._attempt)
        side.begin(now_s)
        return self._asking(side, others)

    def _anew(self, now_s: float, peer: Peer, why: str) -> Out:
        """The attempt has failed; there is another, and where there were many, after a rest."""
        self._side, self._since_s = None, now_s
        if self._tries >= ATTEMPTS:
            self.why, self.busy = f"{why}, in {self._tries} attempts", False
            self._rests_until_s = now_s + LONG * peer.habits.patience_s * RESTS * 2 ** (self._tries - ATTEMPTS)
        return []

    def _asking(self, side: Leader, robots: Sequence[int]) -> Out:
        question = Question(self.root, self.number, side.attempt, side.n, side.asked)
        return [(robot, question) for robot in robots]

    def _give_up(self, why: str) -> Out:
        self.why, self.busy, self._given_up, self._side = why, False, True, None
        return []


def _heard_s(peer: Peer, robot: int) -> float:
    """When a robot was last heard."""
    return peer.lines[robot].heard_s if robot in peer.lines else -1e300
