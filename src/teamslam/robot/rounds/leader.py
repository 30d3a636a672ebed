"""Who asks in exact rounds: the coordinator, whose robots answer over links."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from teamslam.errors import SolveError
from teamslam.joining.exact.coordinator import Ask, Coordinator, Course, Ended, Parts, Reduce, Take, Try
from teamslam.joining.exact.robot import Part
from teamslam.robot.reduced import reduced_from
from teamslam.robot.rounds.pace import Pace
from teamslam.robot.rounds.result import Result
from teamslam.robot.rounds.said import Heard, Said, account_of
from teamslam.robot.rounds.stage import Stage, interiors_of

GAP, MOST = 1e-20, 100  # of F still to be had when rounds end; rounds at most


class Leader:
    """One attempt: it asks the `others`, and itself for its own `parts` and those of robots that are away (`as_sent`).
    `asked`: the question that is open, the `n`th, since `asked_s`; `result`: how it ended, once all know.

    To go where all were last asked to try needs no answer: it is told with the question after it."""

    def __init__(
        self, stage: Stage, own: dict[int, Part], others: Sequence[int], as_sent: Sequence[int], attempt: int
    ) -> None:
        self._stage, self.attempt, self.others, self.as_sent = stage, attempt, others, as_sent
        self._own, self._mine = own, dict(sorted({**own, **stage.as_sent(as_sent)}.items()))
        self._all = Parts(list(self._mine.values()))
        sides = [self._mine.get(n, side) for n, side in enumerate(stage.sides)]
        self._coordinator = Coordinator(sides, stage.raw, stage.joined)
        self._course: Course = self._coordinator.course(GAP, MOST)
        self.n, self.asked, self.asked_s = -1, b"", 0.0
        self._kinds, self._times = list[str](), Counter[tuple[int, int]]()
        self._pace, self._said_s = {robot: Pace() for robot in others}, dict.fromkeys(others, 0.0)
        self._answers: dict[int, Heard] = {}
        self._ask: Ask | None = None
        self._tried = stage.common
        self._last: Said | None = None
        self.result: Result | None = None

    def begin(self, now_s: float) -> None:
        """The first question."""
        self._go_on(now_s, None)

    def hear(self, now_s: float, robot: int, n: int, data: bytes) -> None:
        """An answer."""
        if robot not in self.others or not 0 <= n <= self.n:
            return
        kind, times = self._kinds[n], self._times[n, robot]
        if n == self.n and robot in self.silent:
            self._answers[robot] = msgspec.msgpack.decode(data, type=Heard)
            self._pace[robot].answered(kind, now_s - self.asked_s, times)
        elif times > 1:
            self._pace[robot].twice(kind)

    def attend(self, now_s: float) -> None:
        """Where all answers are there the course goes on, by one question."""
        if self.result is None and not self.silent:
            self._go_on(now_s, self._together())

    def wait_s(self, robot: int, least_s: float) -> float:
        """How long a robot's answer to the open question is waited for before it is asked again."""
        return self._pace[robot].wait_s(self._kinds[self.n], least_s)

    def again(self, now_s: float, least_s: float) -> list[int]:
        """The robots that are asked the open question once more now."""
        due = [robot for robot in self.silent if now_s - self._said_s[robot] >= self.wait_s(robot, least_s)]
        self._tells(now_s, due)
        return due

    def _tells(self, now_s: float, robots: Iterable[int]) -> None:
        for robot in robots:
            self._said_s[robot] = now_s
            self._times[self.n, robot] += 1

    @property
    def silent(self) -> list[int]:
        """Who has not answered yet."""
        return [robot for robot in self.others if robot not in self._answers]

    def _go_on(self, now_s: float, answer: Any) -> None:
        """Ask what is next; once the course has ended, tell how."""
        if self._last is not None:
            self.result = Result(self._last, self._coordinator.values, interiors_of(self._own))
            return
        take = False
        try:
            ask = self._course.throw(answer) if isinstance(answer, SolveError) else self._course.send(answer)
            if take := isinstance(ask, Take):
                self._take()
                ask = self._course.send(None)
            self._ask, said = ask, self._said(ask, take)
        except StopIteration as done:
            self._ask, said = None, self._ended(done.value, take)
            self._last = said
        self.n, self.asked, self._answers = self.n + 1, msgspec.msgpack.encode(said), {}
        self.asked_s = now_s
        self._kinds.append(said.kind)
        self._tells(now_s, self.others)

    def _take(self) -> None:
        """It goes where it last asked to try, and knows that the others do."""
        self._all.answer(Take())
        for n, side in enumerate(self._stage.sides):
            if n not in self._mine:
                side.put(self._tried)

    def _ended(self, ended: Ended, take: bool) -> Said:
        assert ended.ahead is not None
        account = account_of(self._coordinator.exactness(ended))
        return Said("end", take, account=account, cost=ended.ahead.cost, as_sent=tuple(self.as_sent))

    def _said(self, ask: Ask, take: bool) -> Said:
        match ask:
            case Reduce(curvature):
                return Said("reduce", take, curvature)
            case Try(values, share):
                self._tried = values
                return Said("try", take, state=values.state.astype("<f8").tobytes(), share=share)
        raise AssertionError(ask)

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
            found |= dict(zip(places, told, strict=self._ask is not None))
        return [found[n] for n in sorted(found)]
