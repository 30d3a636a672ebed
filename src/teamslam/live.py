"""The story of a robot that maps while it drives, one page: rows in, poses out, submaps as they close.

    rows ─ step ─ the pose of now
            └ close ─ pieces ─ [ build ─ join ─ outlook ] ─ renew

What stands in brackets runs beside the steps, on an executor; where none is given, between two steps.
"""

import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, field, replace
from itertools import groupby
from time import monotonic, sleep

from teamslam.errors import InputError, SolveError
from teamslam.io.plain.lines import Lines
from teamslam.model import Dataset, Names, Submap, Table
from teamslam.robot import Atlas, Estimate, Filter, Options, Robot, outlook
from teamslam.robot.journal import Journal, Memory
from teamslam.robot.rows import batches, head_of, rank_of

Heard = Callable[[], Sequence[Submap]]
Round = tuple[Atlas, Filter | None]


@dataclass(frozen=True, eq=False)
class Moment:
    """The robot after a step: the pose of now, the submaps that were finished since the step before, of pieces that
    gave none, why, and all that was made so far."""

    robot: Robot
    now: Estimate | None
    submaps: tuple[Submap, ...] = ()
    unbuilt: tuple[str, ...] = ()
    atlas: Atlas = field(default_factory=Atlas)


def replayed(log: Dataset, robot: int) -> Iterator[tuple[float, list[Table]]]:
    """The rows of one robot's log as they came: those of each time with its stamp [s], or count."""
    head = head_of(log, robot)
    rows = sorted((b for table in log.tables if table.robot == robot for b in batches(head, table)), key=rank_of)
    for time, moment in groupby(rows, key=lambda batch: batch.time):
        yield max(time, 0) * log.names.tick_s, [batch.table for batch in moment]


def paced(rows: Iterable[tuple[float, list[Table]]], speed: float | None) -> Iterator[list[Table]]:
    """Rows at their time, `speed` seconds of their stamps in one; at once where it is None."""
    began, first = monotonic(), None
    for stamp, tables in rows:
        if speed is not None:
            first = stamp if first is None else first
            sleep(max(0.0, (stamp - first) / speed - (monotonic() - began)))
        yield tables


def spoken(
    lines: Lines, stream: Iterable[str | bytes], wrong: Callable[[InputError], None], quiet_s: float
) -> Iterator[tuple[float, list[Table]]]:
    """The rows that are told as lines, each with its stamp [s]; no rows where for `quiet_s` none came. A line that
    makes no sense is handed to `wrong`, and the rest goes on."""
    told: queue.SimpleQueue[str | bytes | None] = queue.SimpleQueue()

    def listen() -> None:
        for line in stream:
            told.put(line)
        told.put(None)

    threading.Thread(target=listen, name="lines", daemon=True).start()
    stamp_s = 0.0
    while True:
        try:
            line = told.get(timeout=quiet_s)
        except queue.Empty:
            yield stamp_s, []
            continue
        if line is None:
            return
        if not line.strip():
            lines.pass_over()
            continue
        try:
            table = lines.row(line)
        except InputError as error:
            wrong(error)
            continue
        stamp_s = lines.stamp_s(table)
        yield stamp_s, [table]


def begun(log: Dataset, number: int, options: Options | None = None, memory: Memory | None = None) -> Robot:
    """A robot of a log's channels, as its journal remembers it where there is one."""
    robot = Robot.of(log, number, options)
    if memory is None:
        return robot
    called = {**robot.head.names.landmarks, **memory.names}
    return robot.calling(replace(robot.head.names, landmarks=called)).remembering(
        memory.tables, memory.versions, memory.agreed
    )


def drive(
    robot: Robot,
    arrivals: Iterable[Sequence[Table]],
    *,
    executor: Executor | None = None,
    journal: Journal | None = None,
    names: Callable[[], Names] | None = None,
) -> Iterator[Moment]:
    """A robot's moments as its rows arrive, and a last one, without a pose, when all is closed: with the reasons of all
    pieces that gave no submap. What it takes is written into the `journal` before the moment is told. `names` says what
    everybody is called by now, where rows bring new names.

    Law: the submaps of all moments, the newest version of each, are those of `teamslam.split` and `teamslam.build` for
    the rows that arrived, to the bit.
    """
    mapper = Mapper(executor)
    for tables in arrivals:
        robot = (robot if names is None else robot.calling(names())).step(tables)
        if journal is not None:
            journal.step(robot)
        if robot.due:
            robot = robot.close()
        robot, finished = mapper.attend(robot)
        yield Moment(robot, robot.now, finished, atlas=mapper.atlas)
    robot = robot.finish()
    finished = mapper.finish(robot)
    yield Moment(robot, None, finished, mapper.atlas.unbuilt, mapper.atlas)


class Mapper:
    """What runs beside the steps: it makes submaps and maps of what is closed and heard, one round at a time.
    `atlas`: what it has made; `trouble`: why it is made between two steps after all, where its executor broke."""

    def __init__(self, executor: Executor | None = None) -> None:
        self._executor, self.atlas, self.trouble = executor, Atlas(), ""
        self._round: Future[Round] | None = None

    def attend(self, robot: Robot, heard: Heard = tuple) -> tuple[Robot, tuple[Submap, ...]]:
        """Take in the round that has ended, if one has, and begin the next where a piece has closed; `heard` gives what
        is known then of others."""
        finished: tuple[Submap, ...] = ()
        if self._round is None and self._news(robot):
            if self._executor is None:
                robot, finished = self._taken_in(robot, *mapped(self.atlas, robot, heard()))
            else:
                self._round = self._executor.submit(mapped, self.atlas, robot, heard())
        elif self._round is not None and self._round.done():
            robot, finished = self._ended(robot, self._round)
        return robot, finished

    def finish(self, robot: Robot) -> tuple[Submap, ...]:
        """The submaps of all that is left."""
        finished: tuple[Submap, ...] = ()
        if self._round is not None:
            robot, finished = self._ended(robot, self._round)
        _, more = self._taken_in(robot, built(self.atlas, robot), None)
        return finished + more

    def _ended(self, robot: Robot, round: "Future[Round]") -> tuple[Robot, tuple[Submap, ...]]:
        """With what a round has made; what one could not make the next one will, between two steps."""
        self._round = None
        try:
            return self._taken_in(robot, *round.result())
        except BrokenExecutor as error:
            self._executor, self.trouble = None, f"{error}; submaps are made between two steps"
            return robot, ()

    def busy(self, robot: Robot) -> bool:
        """Whether something that is closed is not yet made."""
        return self._round is not None or self._news(robot)

    def _news(self, robot: Robot) -> bool:
        held = self.atlas.stretches
        return any(piece.number not in held or held[piece.number].version < piece.version for piece in robot.closed)

    def _taken_in(self, robot: Robot, atlas: Atlas, start: Filter | None) -> tuple[Robot, tuple[Submap, ...]]:
        before = {(s.id, s.version) for s in self.atlas.submaps}
        self.atlas = atlas
        fresh = tuple(s for s in atlas.submaps if (s.id, s.version) not in before)
        return (robot if start is None else robot.renew(start)), fresh


def built(atlas: Atlas, robot: Robot) -> Atlas:
    """The atlas with all that a robot has closed."""
    for piece in robot.closed:
        held = atlas.stretches.get(piece.number)
        if held is None or held.version < piece.version:
            atlas = atlas.with_stretch(piece.number, piece.version, robot.pieces(piece.number), piece.end)
    return atlas


def mapped(atlas: Atlas, robot: Robot, heard: Sequence[Submap] = ()) -> Round:
    """The atlas with all that a robot has closed and heard, and the filter with which its open rows begin."""
    atlas = built(atlas, robot).in_short(heard, robot.number).anew()
    return atlas, start_of(atlas, robot.since, robot.options.landmarks)


def start_of(atlas: Atlas, since: int | None, landmarks: int) -> Filter | None:
    """The filter with which rows after a pose begin; None where the map does not hold it."""
    if since is None or (known := atlas.map_with(since)) is None:
        return None
    try:
        return outlook(known, since, landmarks)
    except SolveError:
        return None
