"""Links within one process that lose, delay, repeat and reorder by a seed: for tests, and for teams on one machine.

Time is given from outside. The same seed, times and packets give the same course of things.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from teamslam.errors import InputError
from teamslam.robot.link import HEARD
from teamslam.robot.link.inbox import Inbox


@dataclass(frozen=True)
class Weather:
    """What becomes of packets: the share that is lost, and of the others that come twice; each takes from `least_s` to
    `most_s` [s], evenly, so that they overtake each other. `rate` [bytes a second]: how fast a line is; None: at once.
    """

    loss: float = 0.0
    twice: float = 0.0
    least_s: float = 0.0
    most_s: float = 0.0
    rate: float | None = None

    def __post_init__(self) -> None:
        for name in ("loss", "twice"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise InputError(f"a share is from 0 to below 1, found {getattr(self, name)}", field=name)
        if not 0.0 <= self.least_s <= self.most_s < np.inf:
            raise InputError(f"from {self.least_s} to {self.most_s} s is no span of time", field="most_s")
        if self.rate is not None and not 0.0 < self.rate < np.inf:
            raise InputError(f"a line carries more than 0 bytes a second, found {self.rate}", field="rate")


def always(sender: int, receiver: int, now_s: float) -> bool:
    """Everybody reaches everybody."""
    return True


@dataclass
class Air:
    """What connects the robots of one process. `reach` says who reaches whom when."""

    weather: Weather
    seed: int
    reach: Callable[[int, int, float], bool] = always
    now_s: float = 0.0
    carried: dict[tuple[int, int], int] = field(default_factory=dict)
    """Bytes that were sent, by sender and receiver, whether they arrived or not."""

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._ends: dict[int, MemoryLink] = {}
        self._flying: list[tuple[float, int, int, int, bytes]] = []
        self._free: dict[tuple[int, int], float] = {}
        self._count = 0

    def link(self, robot: int) -> "MemoryLink":
        """A robot's end; one that was there is gone with all that it had not fetched."""
        self._ends[robot] = MemoryLink(self, robot)
        return self._ends[robot]

    def leave(self, robot: int) -> None:
        """A robot is gone."""
        self._ends.pop(robot, None)

    def tick(self, now_s: float) -> None:
        """Time goes on: what is due arrives, where its receiver is there and in reach."""
        self.now_s = now_s
        while self._flying and self._flying[0][0] <= now_s:
            due, _, sender, receiver, data = heapq.heappop(self._flying)
            if receiver in self._ends and self.reach(sender, receiver, due):
                self._ends[receiver].inbox.put(sender, data)

    def near(self, robot: int) -> frozenset[int]:
        """The other robots that are there and reach a robot now."""
        there = self._ends.keys() - {robot}
        return frozenset(other for other in there if self.reach(other, robot, self.now_s))

    def carry(self, sender: int, to: int, data: bytes) -> None:
        """Take a packet on its way, to one or (0) to all."""
        for receiver in [to] if to else sorted(self._ends.keys() - {sender}):
            line = (sender, receiver)
            self.carried[line] = self.carried.get(line, 0) + len(data)
            lost, again, *waits = self._rng.uniform(size=4)
            if lost < self.weather.loss:
                continue
            for wait in waits[: 2 if again < self.weather.twice else 1]:
                self._fly(line, self.weather.least_s + wait * (self.weather.most_s - self.weather.least_s), data)

    def _fly(self, line: tuple[int, int], wait_s: float, data: bytes) -> None:
        begins = self.now_s
        if self.weather.rate is not None:
            begins = max(begins, self._free.get(line, 0.0)) + len(data) / self.weather.rate
            self._free[line] = begins
        self._count += 1
        heapq.heappush(self._flying, (begins + wait_s, self._count, *line, data))


@dataclass
class MemoryLink:
    """One robot's end of the air."""

    air: Air
    robot: int
    inbox: Inbox = field(default_factory=Inbox)

    def send(self, to: int, data: bytes) -> None:
        """A packet to a robot, or to all that can be reached (0)."""
        self.air.carry(self.robot, to, data)

    def receive(self, most: int = HEARD) -> list[tuple[int, bytes]]:
        """Packets that have come, at most so many, those of all senders in turns."""
        return self.inbox.take(most)

    @property
    def alive(self) -> frozenset[int]:
        """The robots that are there and in reach now."""
        return self.air.near(self.robot)
