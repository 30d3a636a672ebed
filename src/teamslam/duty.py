"""What one robot is to do: one TOML file, which says all that `teamslam robot` may be told.

    log = "red-log"                 a log, or a folder in the plain format that says what the lines on stdin hold
    robot = "red"
    out = "red"
    lines = true                    rows come from stdin, as they are measured; without it, from the log
    remote = true                   or over the team's network, told as lines on stdin are
    camera = "/dev/video0"          or from a camera that films now: then the log is a team file
    resume = true
    events = "red.jsonl"

    [steps]                         teamslam.robot.Options: poses_per_piece, heading_sigma, horizon_s, landmarks
    [team]                          with it the robot is one of a team; see `Team`
    [habits]                        teamslam.robot.peer.Habits: rate, budget, announce_s, patience_s, largest

Paths are from the folder of the file. What is given on the command line wins.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from teamslam.errors import InputError
from teamslam.io.files.toml import read_toml, record_from
from teamslam.robot import Options
from teamslam.robot.link.zenoh import Address
from teamslam.robot.peer import Habits


@dataclass(frozen=True)
class Team:
    """Where a robot is among its team: the team's `name`, where it listens and whom it connects to (host:port), the
    folder of its `certificates` and the numbers of the `members` that it listens to."""

    name: str = "team"
    listen: str | None = None
    connect: tuple[str, ...] = ()
    certificates: Path | None = None
    members: tuple[int, ...] = ()


@dataclass(frozen=True)
class Duty:
    """What one robot is to do. `events`: a file of what happened, a JSON object a line; `view`: the port of a live map
    in the browser of this machine."""

    log: Path | None = None
    out: Path | None = None
    robot: str | None = None
    lines: bool = False
    remote: bool = False
    camera: str | None = None
    speed: float | None = None
    resume: bool = False
    format: str | None = None
    events: Path | None = None
    view: int | None = None
    steps: Options = field(default_factory=Options)
    team: Team = field(default_factory=Team)
    habits: Habits = field(default_factory=Habits)

    def __post_init__(self) -> None:
        if self.speed is not None and not 0.0 < self.speed < float("inf"):
            raise InputError(f"a speed is above 0, found {self.speed}", field="speed")
        if self.lines and self.speed is not None:
            raise InputError("lines on stdin come at their own speed; leave out speed", field="speed")
        if self.remote and (self.lines or self.speed is not None):
            raise InputError("rows over the network come at their own speed; leave out lines and speed", field="remote")
        if self.camera is not None and (self.lines or self.remote or self.speed is not None):
            raise InputError("a camera films at its own speed; leave out lines, remote and speed", field="camera")

    @property
    def in_real_time(self) -> bool:
        """Whether rows come in their own time: then nothing may make them wait."""
        return self.lines or self.remote or self.camera is not None or self.speed is not None

    def address(self, number: int) -> Address | None:
        """Where the robot with this number is among its team; None where it drives alone."""
        t = self.team
        if t.listen is None:
            return None
        return Address(t.name, number, t.listen, t.connect, t.certificates, t.members)


def read_duty(path: Path) -> Duty:
    """A robot's duty from a TOML file. InputError names the file, the key and the cure."""
    found: Duty = _from(record_from(read_toml(path), Duty, path=path), path.parent)
    return found


def told(record: Any, given: Mapping[str, Any]) -> Any:
    """A record with all that is given (not None) in place of what it has."""
    known = {name: value for name, value in given.items() if value is not None}
    return replace(record, **known) if known else record


def _from(record: Any, folder: Path) -> Any:
    """A record with its paths from a folder."""
    found: dict[str, Any] = {}
    for each in fields(record):
        value = getattr(record, each.name)
        if isinstance(value, Path):
            found[each.name] = folder / value
        elif is_dataclass(value):
            found[each.name] = _from(value, folder)
    return replace(record, **found) if found else record
