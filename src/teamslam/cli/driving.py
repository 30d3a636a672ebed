"""Where a robot's rows come from, and a robot that drives alone."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.beside import Beside
    from teamslam.duty import Duty
    from teamslam.errors import InputError
    from teamslam.io.bags.live_camera import LiveCamera
    from teamslam.io.plain.lines import Lines
    from teamslam.model import Dataset, Names, Submap, Table
    from teamslam.robot import Atlas, Estimate, Robot
    from teamslam.robot.journal import Memory

QUIET_S = 0.02  # without rows, before something else is done


@dataclass(frozen=True, eq=False)
class Source:
    """The `log` whose channels are a robot's, its `number`, and the `lines` in which its rows are told or the `camera`
    that films them, where they do not come from the log itself."""

    log: "Dataset"
    number: int
    lines: "Lines | None" = None
    camera: "LiveCamera | None" = None

    @classmethod
    def of(cls, duty: "Duty") -> "Source":
        """What a duty says. InputError where it cannot be read, or is not of the robot that is meant."""
        from teamslam.io import read
        from teamslam.io.plain.lines import Lines

        assert duty.log is not None
        if duty.lines or duty.remote:
            lines = Lines(duty.log, duty.robot)
            return cls(lines.head, lines.robot, lines)
        if duty.camera is not None:
            from teamslam.io.bags.live_camera import LiveCamera

            camera = LiveCamera(duty.log, duty.camera, duty.robot)
            return cls(camera.head, camera.robot, camera=camera)
        log = read(duty.log, format=duty.format)
        robots = [robot for robot in sorted(log.robots) if log.of_robot(robot).tables]
        return cls(log, _number_of(duty.robot, log.names, robots))

    def rows(
        self,
        start: "Robot",
        memory: "Memory",
        wrong: "Callable[[InputError], None]",
        stream: "Iterable[bytes] | None" = None,
    ) -> "Iterator[tuple[float, list[Table]]]":
        """The rows that a robot does not have yet, each moment's with its stamp; of lines, those to come, on a `stream`
        or stdin."""
        from teamslam.live import replayed, spoken

        if self.camera is not None:
            self.camera.goes_on_after(memory.tables)
            return self.camera.rows()
        if self.lines is None:
            newest_s = start.newest * self.log.names.tick_s
            return (row for row in replayed(self.log, self.number) if row[0] >= newest_s)
        self.lines.goes_on_after(memory.tables, memory.names)
        return spoken(self.lines, sys.stdin.buffer if stream is None else stream, wrong, QUIET_S)

    @property
    def names(self) -> "Callable[[], Names] | None":
        """What everybody is called by now, where rows bring new names."""
        lines = self.lines
        return None if lines is None else lambda: lines.names


class Shown:
    """The live map of a robot, where one is wanted: it is drawn anew when the robot's map is another, whether that was
    made between steps (its atlas) or `beside` them."""

    def __init__(self, port: int | None, beside: "Beside | None") -> None:
        from teamslam.cli.console import say

        self._live, self._beside, self._known = None, beside, tuple["Submap", ...]()
        if port is not None:
            from teamslam.viewer.live import LiveMap

            self._live = LiveMap(port)
            say(f"live map: {self._live.address}")

    def show(self, now: "Estimate | None", atlas: "Atlas", robot: int) -> None:
        """What is known now."""
        if self._live is None:
            return
        parts = atlas.parts or (self._beside.parts if self._beside is not None else ())
        if parts and (not self._known or parts[0] is not self._known[0]):
            self._known = parts
            self._live.show(next((part for part in parts if robot in part.robots_in_it), parts[0]))
        if now is not None:
            self._live.at(now)

    def close(self) -> None:
        """End it."""
        if self._live is not None:
            self._live.close()


class Finished:
    """The folder of finished submaps. What the disk does not take waits (`trouble`)."""

    def __init__(self, folder: Path) -> None:
        self.trouble, self._folder, self._waiting = "", folder, list["Submap"]()

    def add(self, submaps: "Sequence[Submap]" = ()) -> None:
        """Some more; and those that wait, once more."""
        from teamslam.errors import InputError
        from teamslam.io.submaps.arrays import file_name, write_submap

        self._waiting += submaps
        try:
            while self._waiting:
                write_submap(self._waiting[0], self._folder / file_name(self._waiting[0]))
                del self._waiting[0]
            self.trouble = ""
        except OSError as error:
            self.trouble = f"{error.filename or self._folder}: {error.strerror}; {len(self._waiting)} submaps wait"
        except InputError as error:  # a file that cannot be begun
            self.trouble = f"{error}; {len(self._waiting)} submaps wait"


class Disks:
    """Troubles with disks, each said when it begins and once it is over."""

    def __init__(self) -> None:
        self.now: dict[str, str] = {}

    def tell(self, **troubles: str) -> None:
        """Those of now, in words, by what they befall; empty: none."""
        from teamslam.cli.console import complain

        for what, trouble in troubles.items():
            before = self.now.get(what, "")
            if trouble and not before:
                complain(trouble)
            elif before and not trouble:
                complain(f"{what}: written again")
        self.now |= troubles

    @property
    def words(self) -> str:
        """All that is wrong."""
        return "; ".join(filter(None, self.now.values()))


def alone(duty: "Duty", source: Source) -> int:
    """A robot that drives alone, until its rows end."""
    from teamslam.beside import Beside
    from teamslam.cli.console import complain, say
    from teamslam.cli.lasting import lasting
    from teamslam.events import Events
    from teamslam.live import begun, drive, paced
    from teamslam.results.poses import PoseFile
    from teamslam.results.words import counted
    from teamslam.robot.journal import Journal
    from teamslam.robot.rows import head_of

    out = Path(str(duty.out))
    (out / "submaps").mkdir(parents=True, exist_ok=duty.resume)
    log, number, submaps, late = source.log, source.number, 0, 0
    finished, disks = Finished(out / "submaps"), Disks()
    wrong: list[InputError] = []
    events = Events(duty.events)
    events.tell("begun", robot=log.names.robot(number))

    def heard(error: "InputError") -> None:
        wrong.append(error)
        complain(str(error))
        events.tell("wrong", reason=str(error))

    with (
        Journal(out / "journal.db", head_of(log, number)) as journal,
        PoseFile(out / "poses.csv", log.names, log.robots[number]) as poses,
        Beside(shown=duty.view is not None) if duty.in_real_time else nullcontext() as beside,
        closing(Shown(duty.view, beside)) as shown,
        lasting(),
    ):
        memory = journal.recall()
        start = begun(log, number, duty.steps, memory)
        rows = (row for row in source.rows(start, memory, heard) if row[1])
        arrivals = paced(rows, duty.speed)
        for moment in drive(start, arrivals, executor=beside, journal=journal, names=source.names):
            poses.add(moment.now)
            shown.show(moment.now, moment.atlas, number)
            finished.add(moment.submaps)
            for submap in moment.submaps:
                events.tell("submap", id=submap.id, version=submap.version)
            submaps += len(moment.submaps)
            disks.tell(journal=journal.trouble, poses=poses.trouble, submaps=finished.trouble, events=events.trouble)
            events.changed({"rows": {"late": moment.robot.counts.late}, "journal": journal.trouble})
        finished.add()
    disks.tell(journal=journal.trouble, poses=poses.trouble, submaps=finished.trouble)
    for trouble in memory.damaged:
        complain(trouble)
    for reason in moment.unbuilt:
        complain(f"a piece gave no submap: {reason}")
    late = moment.robot.counts.late
    if late:
        complain(f"{counted(late, 'row')} came more than {duty.steps.horizon_s:g} s behind and were left out")
    say(f"written: {out}: {counted(poses.rows, 'pose')}, {counted(submaps, 'submap')}")
    code = 1 if late or wrong or moment.unbuilt or memory.damaged or disks.words else 0
    events.tell("ended", code=code)
    events.close()
    return code


def _number_of(name: str | None, names: "Names", robots: Sequence[int]) -> int:
    """The number of the robot that is meant. InputError where it is none of a log's, or must be named."""
    from teamslam.errors import InputError

    known = {names.robot(number): number for number in robots}
    if name is None and len(known) == 1:
        return robots[0]
    if name in known:
        return known[name]
    there = ", ".join(known)
    if name is None:
        raise InputError(f"this log is of several robots ({there}); say which with --robot", field="robot")
    raise InputError(f"this log has no robot '{name}'; it is of: {there}", field="robot")
