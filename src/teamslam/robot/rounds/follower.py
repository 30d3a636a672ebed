"""Who answers in exact rounds, for its own submaps and from its own rows."""

import msgspec
import numpy as np

from teamslam.errors import SolveError
from teamslam.joining.exact.coordinator import Parts, Reduce, Take, Try
from teamslam.joining.exact.robot import Part, Reduced
from teamslam.model import Values
from teamslam.robot.reduced import to_numbers
from teamslam.robot.rounds.result import Result
from teamslam.robot.rounds.said import Heard, Said
from teamslam.robot.rounds.stage import Stage, interiors_of


class Follower:
    """It answers the robot `leader` in one attempt, for its own `parts`, by their places. `values`: where separators
    are; `asked_s`: when it was asked last; `result`: how it ended, once it has. Then it lets go of its parts, and
    answers from memory alone."""

    def __init__(self, stage: Stage, parts: dict[int, Part], leader: int, attempt: int) -> None:
        self._parts, self.leader, self.attempt, self.asked_s = parts, leader, attempt, -1e300
        self._stage, self._all = stage, Parts(list(parts.values()))
        self._at, self._last = -1, b""
        self.values = self._tried = stage.common
        self.result: Result | None = None

    def answer(self, n: int, data: bytes) -> bytes | None:
        """The answer to question n; None where the one before it was never heard."""
        if n == self._at + 1:
            self._at, self._last = n, msgspec.msgpack.encode(self._answer(msgspec.msgpack.decode(data, type=Said)))
        return self._last if n == self._at else None

    def _answer(self, said: Said) -> Heard:
        try:
            if said.take:
                self._all.answer(Take())
                self.values = self._tried
            match said.kind:
                case "reduce":
                    found: list[Reduced] = self._all.answer(Reduce(said.curvature))
                    return Heard(reduced=tuple(map(to_numbers, found)))
                case "try":
                    self._tried = Values(self._stage.common.layout, np.frombuffer(said.state, "<f8").astype(float))
                    return Heard(costs=tuple(self._all.answer(Try(self._tried, said.share))))
                case "end":
                    self.result = Result(said, self.values, interiors_of(self._parts))
                    self._parts, self._all = {}, Parts([])
            return Heard()
        except SolveError as error:
            return Heard(problem=str(error))
