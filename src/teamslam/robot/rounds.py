"""Exact rounds between robots: when all hold the same and have nothing more to say, the team goes on to the full least
squares, though nobody holds all raw data (`joining.exact`).

    lowest robot     asks:    where are you, what would it cost you there, go there
    the others       answer:  for their own submaps, from their own rows

What is spoken of, all make alike of the set that they hold: the root that names it names the rounds too. A question is
asked again until it is answered, and answered again from memory; so packets may be lost, late and repeated. Who does
not answer for long ends the rounds, and they begin anew, some times; anything new that is heard ends them as well. What
was there before, the map of the set, stays as it was: rounds give what is better beside it, or the reason why not.
"""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from teamslam.errors import SolveError, TeamslamError
from teamslam.geometry import IntArray
from teamslam.joining.exact.coordinator import (
    Ask,
    Coordinator,
    Course,
    Ended,
    Far,
    Parts,
    Reduce,
    Take,
    Try,
    common_keys,
)
from teamslam.joining.exact.gap import point_of
from teamslam.joining.exact.robot import Part, Reduced, Sending, separators_of
from teamslam.joining.join.join import Exactness
from teamslam.joining.join.optimum import usable_rows
from teamslam.model import WORLD, Dataset, Sources, Submap, Table, Values, robot_of
from teamslam.robot.packets import Answer, Packet, Question
from teamslam.robot.peer import Peer
from teamslam.robot.reduced import reduced_from, to_numbers
from teamslam.robot.robot import Robot
from teamslam.solver.newton import Curvature

GAP, MOST = 1e-20, 100  # of F still to be had when rounds end; rounds at most
ATTEMPTS, LONG = 3, 10  # of rounds on one set; patiences that an answer is waited for
SECONDS = 10.0  # that a round may take on a line with a rate


class Said(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What a question says: reduce (with `curvature`), try (`state`, `share`), take, or end (`account`)."""

    kind: Literal["reduce", "try", "take", "end"]
    curvature: Curvature = "none"
    state: bytes = b""
    share: float = 0.0
    account: tuple[float, ...] = ()


class Heard(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What an answer says: of each submap what is left of it, or a cost; or why there is none."""

    reduced: tuple[bytes, ...] = ()
    costs: tuple[float, ...] = ()
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Stage:
    """What all robots make alike of one set of submaps: the first part of its map, `sides` of its submaps, and how
    separators' places are written down."""

    joined: Submap
    sides: tuple[Far, ...]
    raw: tuple[Table, ...]
    separators: IntArray
    common: Values

    @classmethod
    def of(cls, peer: Peer) -> "Stage":
        """Raises as a join does."""
        component = peer.held.join().components[0]
        by_id = {submap.id: submap for submap in peer.held.submaps}
        submaps, point = [by_id[name] for name in component.members], point_of(component.map)
        world = component.map.base == WORLD
        raw, _ = usable_rows([t for s in submaps for t in s.raw], point.layout, world=world)
        separators = separators_of(submaps, raw)
        sides = tuple(Far(submap, Sending.of(submap, separators)) for submap in submaps)
        return cls(component.map, sides, tuple(raw), separators, point.only(common_keys(sides, raw)))

    def of_robot(self, number: int) -> list[int]:
        """The places of a robot's submaps among all."""
        return [n for n, side in enumerate(self.sides) if int(robot_of(side.submap.base)) == number]

    @property
    def robots(self) -> set[int]:
        """Whose submaps are in it."""
        return {int(robot_of(side.submap.base)) for side in self.sides}

    def parts(self, peer: Peer, robot: Robot) -> list[Part]:
        """A robot's own submaps with the rows that they were built of."""
        pieces = {Sources.of(p.tables): p for closed in robot.closed for p in robot.pieces(closed.number)}
        own = [self.sides[n].submap for n in self.of_robot(peer.number)]
        return [Part(_piece(pieces, submap), submap, self.separators) for submap in own]


def _piece(pieces: dict[Sources, Dataset], submap: Submap) -> Dataset:
    if submap.sources not in pieces:
        raise SolveError(f"the rows of {submap.id} are not at hand")
    return pieces[submap.sources]


class Follower:
    """Who answers. It begins anew with each attempt."""

    def __init__(self, stage: Stage, parts: Sequence[Part]) -> None:
        self._stage, self._parts, self._all = stage, parts, Parts(parts)
        self._at, self._last = -1, b""
        self.values = stage.common
        self._tried = stage.common
        self.exactness: Exactness | None = None

    def answer(self, n: int, data: bytes) -> bytes | None:
        """The answer to question n; None where the one before it was never heard."""
        if n == self._at + 1:
            self._at, self._last = n, msgspec.msgpack.encode(self._answer(msgspec.msgpack.decode(data, type=Said)))
        return self._last if n == self._at else None

    def _answer(self, said: Said) -> Heard:
        try:
            match said.kind:
                case "reduce":
                    found: list[Reduced] = self._all.answer(Reduce(said.curvature))
                    return Heard(reduced=tuple(map(to_numbers, found)))
                case "try":
                    self._tried = Values(self._stage.common.layout, np.frombuffer(said.state, "<f8").astype(float))
                    return Heard(costs=tuple(self._all.answer(Try(self._tried, said.share))))
                case "take":
                    self._all.answer(Take())
                    self.values = self._tried
                case "end":
                    gap, gradient, shift, of_join, rounds, size = said.account
                    self.exactness = Exactness(gap, gradient, shift, of_join, int(rounds), int(size))
            return Heard()
        except SolveError as error:
            return Heard(problem=str(error))


class Leader:
    """Who asks. `asked`: the question that is open, by number."""

    def __init__(self, stage: Stage, peer: Peer, parts: Sequence[Part], attempt: int) -> None:
        self._stage, self._parts, self._all, self.attempt = stage, parts, Parts(parts), attempt
        own = dict(zip(stage.of_robot(peer.number), parts, strict=True))
        self._mine, self.others = own, sorted(stage.robots - {peer.number})
        sides = [own.get(n, side) for n, side in enumerate(stage.sides)]
        self._coordinator = Coordinator(sides, stage.raw, stage.joined)
        self._course: Course = self._coordinator.course(GAP, MOST)
        self.n, self.asked, self.asked_s, self.said_s = -1, b"", 0.0, 0.0
        self._answers: dict[int, Heard] = {}
        self._ask: Ask | None = None
        self._tried = stage.common
        self.exactness: Exactness | None = None
        self.ended = False

    @property
    def values(self) -> Values:
        """Where the separators are."""
        return self._coordinator.values

    def begin(self, now_s: float) -> None:
        """The first question."""
        self._go_on(now_s, None)

    def hear(self, now_s: float, robot: int, n: int, data: bytes) -> None:
        """An answer; when all are there the course goes on."""
        if n != self.n or robot not in self.others:
            return
        self._answers[robot] = msgspec.msgpack.decode(data, type=Heard)
        if len(self._answers) == len(self.others):
            self._go_on(now_s, self._together())

    @property
    def silent(self) -> list[int]:
        """Who has not answered yet."""
        return [robot for robot in self.others if robot not in self._answers]

    def _go_on(self, now_s: float, answer: Any) -> None:
        """Ask what is next; once the course has ended, tell how."""
        if self.exactness is not None:
            self.ended = True
            return
        try:
            self._ask = self._course.throw(answer) if isinstance(answer, SolveError) else self._course.send(answer)
            said = self._said(self._ask)
        except StopIteration as done:
            ended: Ended = done.value
            self._ask, self.exactness = None, self._coordinator.exactness(ended)
            said = Said("end", account=tuple(map(float, astuple(self.exactness))))
        self.n, self.asked, self._answers = self.n + 1, msgspec.msgpack.encode(said), {}
        self.asked_s = self.said_s = now_s

    def _said(self, ask: Ask) -> Said:
        match ask:
            case Reduce(curvature):
                return Said("reduce", curvature)
            case Try(values, share):
                self._tried = values
                return Said("try", state=values.state.astype("<f8").tobytes(), share=share)
        for n, side in enumerate(self._stage.sides):
            if n not in self._mine:
                side.put(self._tried)
        return Said("take")

    def _together(self) -> Any:
        """All answers as the course wants them, in the order of the submaps; a SolveError where one has none."""
        problems = [heard.problem for heard in self._answers.values() if heard.problem]
        if problems:
            return SolveError(problems[0])
        try:
            mine = self._all.answer(self._ask) if self._ask is not None else None
        except SolveError as error:
            return error
        found: dict[int, Any] = dict(zip(self._mine, mine or (), strict=False))
        for robot, heard in self._answers.items():
            places = self._stage.of_robot(robot)
            if isinstance(self._ask, Reduce):
                sizes = [self._stage.sides[n].sending for n in places]
                told: Iterable[Any] = map(reduced_from, heard.reduced, sizes)
            else:
                told = heard.costs
            found |= dict(zip(places, told, strict=not isinstance(self._ask, Take | None)))
        return [found[n] for n in sorted(found)]


class Rounds:
    """A robot's side of exact rounds, whichever that is on the set that it holds now. `root` names that set;
    `exactness`: of what they came to; `why`: why there is none; `busy`: there may be one yet."""

    def __init__(self) -> None:
        self._begin(b"", 0.0)

    def _begin(self, root: bytes, now_s: float) -> None:
        self.root, self._since_s = root, now_s
        self._side: Leader | Follower | None = None
        self._attempt = 0
        self.exactness: Exactness | None = None
        self.why, self.busy = "", False

    @property
    def values(self) -> Values | None:
        """Where separators are (landmarks, poses that several submaps share), once rounds have ended."""
        return self._side.values if self._side is not None and self.exactness is not None else None

    def attend(
        self, now_s: float, peer: Peer, robot: Robot, heard: Sequence[tuple[int, Packet]], ready: bool
    ) -> list[tuple[int, Packet]]:
        """Questions and answers to be sent, after those that were `heard`. `ready`: there is nothing else to say."""
        if peer.root != self.root:
            self._begin(peer.root, now_s)
        if not ready:
            self.busy = False
            return []
        numbers = sorted({int(robot_of(submap.base)) for submap in peer.held.submaps})
        try:
            if numbers[:1] == [peer.number]:
                return self._lead(now_s, peer, robot, numbers[1:], heard)
            questions = [(s, q) for s, q in heard if isinstance(q, Question) and numbers[:1] == [s]]
            return [out for sender, question in questions for out in self._follow(peer, robot, sender, question)]
        except (TeamslamError, msgspec.DecodeError, ValueError, zlib.error) as error:
            self._give_up(str(error))
            return []

    def _follow(self, peer: Peer, robot: Robot, sender: int, asked: Question) -> list[tuple[int, Packet]]:
        if asked.root != self.root or asked.attempt < self._attempt:
            return []
        if not isinstance(self._side, Follower) or asked.attempt > self._attempt:
            stage = Stage.of(peer)
            self._side, self._attempt = Follower(stage, stage.parts(peer, robot)), asked.attempt
        answer = self._side.answer(asked.n, asked.data)
        self.exactness = self._side.exactness
        return [] if answer is None else [(sender, Answer(asked.root, asked.attempt, asked.n, answer))]

    def _lead(
        self, now_s: float, peer: Peer, robot: Robot, others: Sequence[int], heard: Sequence[tuple[int, Packet]]
    ) -> list[tuple[int, Packet]]:
        if self.why or self.exactness is not None:
            return []
        self.busy, long_s = True, LONG * peer.habits.patience_s
        if self._side is None:
            if not others or peer.in_short or peer.habits.budget is not None:
                return self._give_up("one robot alone" if not others else "the links are too tight")
            away = [n for n in others if n not in peer.lines or peer.lines[n].root != self.root]
            if away:
                gone = now_s - self._since_s > long_s
                return self._give_up(f"robot {away[0]} is not there, or holds something else") if gone else []
            stage = Stage.of(peer)
            if not _light(stage, peer.habits.rate):
                return self._give_up("the links are too tight")
            self._attempt += 1
            self._side = Leader(stage, peer, stage.parts(peer, robot), self._attempt)
            self._side.begin(now_s)
            return self._asking(self._side.others)
        assert isinstance(self._side, Leader)
        before = self._side.n
        for sender, packet in heard:
            if isinstance(packet, Answer) and (packet.root, packet.attempt) == (self.root, self._attempt):
                self._side.hear(now_s, sender, packet.n, packet.data)
        if self._side.ended:
            self.exactness, self.busy = self._side.exactness, False
            return []
        if self._side.n != before:
            return self._asking(self._side.others)
        if now_s - self._side.asked_s > long_s:
            silent, n = self._side.silent, self._side.n
            self._side, self._since_s = None, now_s
            if self._attempt >= ATTEMPTS:
                return self._give_up(f"robot {silent[0]} did not answer question {n} in {long_s:g} s")
            return []
        if now_s - self._side.said_s >= peer.habits.patience_s:
            self._side.said_s = now_s
            return self._asking(self._side.silent)
        return []

    def _asking(self, robots: Sequence[int]) -> list[tuple[int, Packet]]:
        assert isinstance(self._side, Leader)
        question = Question(self.root, self._attempt, self._side.n, self._side.asked)
        return [(robot, question) for robot in robots]

    def _give_up(self, why: str) -> list[tuple[int, Packet]]:
        self.why, self.busy, self._side = why, False, None
        return []


def _light(stage: Stage, rate: float | None) -> bool:
    """Whether a round takes no longer on a line than it may."""
    if rate is None:
        return True
    sent = [8 * sum(stage.sides[n].sending.numbers for n in stage.of_robot(robot)) for robot in stage.robots]
    return max(sent) <= SECONDS * rate
