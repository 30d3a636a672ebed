"""Submaps and maps made in a process of their own, which keeps what it has made: only news goes over.

    submit     to it: pieces that closed, submaps heard since;   from it: the submaps that it built, where the open rows
               begin; the map itself only where somebody looks at it

What a round costs the robot's own process does not grow with the map, and no step waits for it: not for the map, not
for the interpreter, not for what is sent. Where that process ends, whatever ended it, rounds are made between two steps
again (`Mapper`): the robot maps on. Where the robot's process ends, at any instruction, this one ends as well.
"""

import os
import queue
import signal
import threading
from collections.abc import Callable, Sequence, Set
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from teamslam.errors import TeamslamError
from teamslam.live import mapped, start_of
from teamslam.model import Dataset, Submap
from teamslam.robot import Atlas, Filter, Robot
from teamslam.robot.atlas import Stretch

NICE = 5  # steps go first


@dataclass(frozen=True, eq=False)
class News:
    """What a round needs to know: pieces that closed or came again (number, version, their logs, where they end), what
    was heard since, the names and versions of all that was heard, whose it is, and where its open rows begin."""

    pieces: tuple[tuple[int, int, list[Dataset], int | None], ...]
    fresh: tuple[Submap, ...]
    heard: tuple[tuple[str, int], ...]
    robot: int
    since: int | None
    landmarks: int


@dataclass(frozen=True, eq=False)
class Call:
    """A function to be called, and with what."""

    fn: Callable[..., Any]
    args: tuple[Any, ...]


def news_of(atlas: Atlas, robot: Robot, heard: Sequence[Submap], known: Set[tuple[str, int]]) -> News:
    """What is news where the atlas, and what was heard by the names and versions `known`, are there already."""
    pieces = tuple(
        (piece.number, piece.version, robot.pieces(piece.number), piece.end)
        for piece in robot.closed
        if piece.number not in atlas.stretches or atlas.stretches[piece.number].version < piece.version
    )
    names = tuple((submap.id, submap.version) for submap in heard)
    fresh = tuple(submap for submap, name in zip(heard, names, strict=True) if name not in known)
    return News(pieces, fresh, names, robot.number, robot.since, robot.options.landmarks)


class Beside(Executor):
    """An executor of `teamslam.live.mapped`, for one robot. `parts`: those of the map of the last round, where it is to
    be `shown`."""

    def __init__(self, *, shown: bool = False) -> None:
        self.parts: tuple[Submap, ...] = ()
        here, there = get_context("spawn").Pipe()
        self._process = get_context("spawn").Process(target=_kept_up, args=(there, shown), name="map", daemon=True)
        self._process.start()
        there.close()
        self._known: set[tuple[str, int]] = set()
        self._orders: queue.SimpleQueue[tuple[News | Call, Atlas | None, Future[Any]] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._asked, args=(here,), name="map", daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        """A round of `mapped(atlas, robot, heard)`: the atlas with what was made, and the filter to begin with. All
        else is called there as it stands; it must not raise."""
        if fn is not mapped:
            called: Future[Any] = Future()
            self._orders.put((Call(fn, args), None, called))
            return called
        atlas, robot, heard = args
        news = news_of(atlas, robot, heard, self._known)
        self._known = set(news.heard)
        future: Future[Any] = Future()
        self._orders.put((news, atlas, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the process; a round that runs is not waited for."""
        self._orders.put(None)
        self._process.terminate()
        self._process.join()

    def _asked(self, line: Connection) -> None:
        """Send and hear, in a thread: nothing of it makes a step wait."""
        while (order := self._orders.get()) is not None:
            news, atlas, future = order
            try:
                line.send(news)
                if atlas is None:
                    future.set_result(line.recv())
                    continue
                made, start, self.parts = line.recv()
                future.set_result((replace(atlas, stretches={**atlas.stretches, **made}), start))
            except Exception as error:  # whatever it was: the robot maps on without
                future.set_exception(BrokenProcessPool(f"the process that makes the map has ended: {error}"))


def _kept_up(line: Connection, shown: bool) -> None:
    """What runs in the process: rounds, until the other end is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is the robot's to hear
    os.nice(NICE)
    atlas, heard = Atlas(), dict[tuple[str, int], Submap]()
    while True:
        try:
            news: News | Call = line.recv()
            if isinstance(news, Call):
                line.send(news.fn(*news.args))
                continue
            heard |= {(submap.id, submap.version): submap for submap in news.fresh}
            heard = {name: heard[name] for name in news.heard}
            atlas, made, start = made_of(atlas, news, list(heard.values()))
            line.send((made, start, atlas.parts if shown else ()))
        except (EOFError, OSError):
            return


def made_of(atlas: Atlas, news: News, heard: Sequence[Submap]) -> tuple[Atlas, dict[int, Stretch], Filter | None]:
    """The atlas after a round, its new stretches, and the filter to begin with."""
    for number, version, pieces, end in news.pieces:
        atlas = atlas.with_stretch(number, version, pieces, end)
    made = {number: atlas.stretches[number] for number, *_ in news.pieces}
    try:
        atlas = atlas.in_short(heard, news.robot).anew()
        return atlas, made, start_of(atlas, news.since, news.landmarks)
    except TeamslamError:
        return atlas, made, None
