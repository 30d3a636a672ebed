"""A robot of teamslam in a thread, as its duty says. It needs no ROS.

    rows ─ tell ─ thread ─ step ─ show: the pose of now, the parts of the map
                     └ a process of its own: submaps, maps, messages (`teamslam.beside`)

No step waits for a join: the thread hands over what closed, and takes in what was made.
"""

import json
import queue
import threading
from collections.abc import Callable, Mapping
from contextlib import closing
from typing import Any

from teamslam.beside import Beside
from teamslam.convoy import Driver
from teamslam.duty import Duty
from teamslam.errors import TeamslamError
from teamslam.fleet import Member
from teamslam.io.plain.lines import Lines
from teamslam.live import Mapper, begun, spoken
from teamslam.model import Submap
from teamslam.robot import Estimate
from teamslam.robot.journal import Journal
from teamslam.robot.link.keys import read_revocations, read_seal
from teamslam.robot.link.zenoh import ZenohLink
from teamslam.robot.peer import Peer
from teamslam.robot.rows import head_of
from teamslam.robot.scribe import Scribe

QUIET_S = 0.02  # without rows, before something else is done

Show = Callable[[Estimate, tuple[Submap, ...]], None]


class Nobody:
    """The link of a robot that drives alone."""

    alive = frozenset[int]()

    def send(self, to: int, data: bytes) -> None:
        """To nobody."""

    def receive(self, most: int = 0) -> list[tuple[int, bytes]]:
        """From nobody."""
        return []

    def close(self) -> None:
        """Nothing is open."""


class Driven:
    """The robot of a duty (lines = true), from now until it leaves.

    `show` is called from the thread now and then, where one of them is new, with the pose of now and the parts of the
    map so far; `warn` with what is wrong, in a sentence. `driver`: what drives it, once its journal is read.
    """

    def __init__(self, duty: Duty, show: Show, warn: Callable[[str], None]) -> None:
        self.lines = Lines(duty.log, duty.robot)
        self._duty, self._show, self._warn = duty, show, warn
        self._told: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._left = threading.Event()
        self.driver: Driver | None = None
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._thread.start()

    @property
    def dim(self) -> int:
        """2 or 3."""
        return self.lines.head.robots[self.lines.robot]

    def tell(self, row: Mapping[str, Any]) -> None:
        """A row, as an object of a line of `teamslam robot --lines`."""
        self._told.put(json.dumps(row))

    def leave(self, seconds: float = 30.0) -> bool:
        """All that was told is taken, its last submap closes, and its journal. False where that took longer: a robot
        that is started anew goes on from its journal."""
        self._left.set()
        self._told.put(None)
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            self._drive()
        except TeamslamError as error:
            self._warn(f"the robot has ended: {error}")

    def _drive(self) -> None:
        duty, number, head = self._duty, self.lines.robot, self.lines.head
        duty.out.mkdir(parents=True, exist_ok=True)
        address, peer = duty.address(number), Peer(number, duty.habits)
        if address is not None and address.certificates is not None:
            seal = read_seal(address.certificates, address.team, number, address.members, head.names)
            peer = Peer(number, duty.habits, seal).recalling(read_revocations(address.certificates))
        with (
            Journal(duty.out / "journal.db", head_of(head, number)) as journal,
            closing(Nobody() if address is None else ZenohLink(address)) as link,
            Beside(shown=True) as beside,
        ):
            memory = journal.recall()
            for trouble in memory.damaged:
                self._warn(trouble)
            self.lines.goes_on_after(memory.tables, memory.names)
            start, peer = begun(head, number, duty.steps, memory), peer.recalling(memory.bodies)
            member = Member(start, peer, link, Mapper(beside), Scribe(beside))

            last: tuple[Estimate | None, tuple[Submap, ...]] = None, ()

            def report(driver: Driver) -> None:
                nonlocal last
                parts = member.mapper.atlas.parts or beside.parts
                now = member.told[-1] if member.told else last[0]
                member.told.clear()
                if now is not None and (now is not last[0] or parts is not last[1]):
                    last = now, parts
                    self._show(now, parts)

            self.driver = driver = Driver(member, journal, report, names=lambda: self.lines.names)
            driver.leave = lambda: driver.parked and self._left.is_set()
            driver.drive(spoken(self.lines, iter(self._told.get, None), self._wrong, QUIET_S), None)

    def _wrong(self, error: TeamslamError) -> None:
        self._warn(str(error))
