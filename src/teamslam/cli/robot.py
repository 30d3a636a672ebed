"""`teamslam robot`: a robot that maps while it drives."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import MaybeWhole, whole
from teamslam.cli.steps import NONE, Steps


def robot(
    log: Path | None = None,
    /,
    *,
    out: Path | None = None,
    config: Path | None = None,
    robot: str | None = None,
    steps: Steps = NONE,
    lines: Annotated[bool | None, Parameter(negative="")] = None,
    remote: Annotated[bool | None, Parameter(negative="")] = None,
    camera: str | None = None,
    speed: float | None = None,
    resume: Annotated[bool | None, Parameter(negative="")] = None,
    team: str | None = None,
    listen: str | None = None,
    connect: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (),
    certificates: Path | None = None,
    members: Annotated[tuple[int, ...], Parameter(converter=whole, consume_multiple=True, negative="")] = (),
    rate: float | None = None,
    budget: float | None = None,
    events: Path | None = None,
    view: MaybeWhole = None,
    format: str | None = None,
) -> int:
    """Map while driving: rows come from stdin as they are measured, or a robot's log is played as if they came now.

    After each moment the pose of now is there with its covariance, from the rows so far alone; submaps are written as
    they close. They are those that `teamslam build` makes of the same log with the same options, to the bit.

    ```
    teamslam robot MRCLAM_Dataset6 --robot 3 --out robot-3
    teamslam robot MRCLAM_Dataset6 --robot 3 --out robot-3 --poses-per-piece 300 --speed 10
    teamslam join robot-1/submaps robot-3/submaps --out map
    my-sensors | teamslam robot red-sensors --lines --out red
    teamslam robot hand.toml --camera /dev/video0 --out hand
    teamslam robot log --robot 3 --out robot-3 --listen 10.0.0.3:7447 --connect 10.0.0.1:7447
    teamslam robot --config red.toml
    ```

    In the folder: `poses.csv`, a line for each moment, `submaps/`, a file for each submap, and `journal.db`, all that
    was heard: a robot that was killed at any moment goes on from it with --resume, and ends with the same submaps.

    Exit codes: 0 done; 1 some rows came too late, some piece gave no submap, or the journal is damaged or could not be
    written; 2 bad input or usage.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists; with --lines, a folder in the plain
        format that says what the lines hold; with --camera, a team file.
    out
        The folder to write; it must not exist or be empty.
    config
        A TOML file that says all this; what is given here wins.
    robot
        The robot's name. Needed where the log is of several.
    lines
        Rows come from stdin, a JSON object a line, as they are measured.
    remote
        Rows come over the team's network, told as with --lines: in packets of one line or more at
        teamslam/TEAM/rows/NUMBER, from a program that has the robot's certificate. An empty packet ends them. Needs
        --listen.
    camera
        Rows come from a camera that films now: its number or path (0, /dev/video0; a film or a pipe plays one). LOG is
        a team file, of which the robot has this one camera and no odometry.
    speed
        How many seconds of the log go by in one. By default as fast as can be.
    resume
        Go on in a folder where a robot was stopped or killed: what its journal holds is not asked for again.
    team
        The name of the team that it exchanges submaps with [default: team].
    listen
        Where it can be reached by its team, as 192.168.1.3:7447. Without it, it drives alone. With it, it goes on
        talking when its rows have ended, until it is ended (SIGTERM, Ctrl-C); then it writes the team map into `maps/`,
        and where exact rounds have put it into `exact/`. How it stands is in `status.json` all the time.
    connect
        Where some of its team can be reached; of the others it learns from them.
    certificates
        The folder with its certificates, as `teamslam keys` makes them. Without it all is in the clear.
    members
        The numbers of the robots that it listens to, where there are certificates.
    rate
        How many bytes of submaps a second it sends to each other robot. By default all that it is asked for.
    budget
        How many bytes it sends to each other robot in all: what is worth most goes first, and where it is tight its
        submaps go rounded or condensed. By default any number.
    events
        A file that what happens is added to, a JSON object a line.
    view
        The port of a live map in the browser of this machine: http://127.0.0.1:PORT.
    format
        The format of the log, where it cannot be told from its looks.
    """
    from teamslam.cli.driving import Source, alone
    from teamslam.duty import Duty, read_duty, told
    from teamslam.errors import InputError
    from teamslam.results import refuse_to_overwrite

    duty: Duty = told(
        read_duty(config) if config is not None else Duty(),
        {"log": log, "out": out, "robot": robot, "lines": lines, "remote": remote, "camera": camera, "resume": resume,
         "events": events, "view": view, "format": format, "speed": speed},
    )  # fmt: skip
    where = {"name": team, "listen": listen, "connect": connect or None, "certificates": certificates}
    duty = replace(
        duty, steps=steps.over(duty.steps), habits=told(duty.habits, {"rate": rate, "budget": budget}),
        team=told(duty.team, where | {"members": members or None}),
    )  # fmt: skip
    if duty.log is None or duty.out is None:
        missing = "LOG" if duty.log is None else "--out"
        raise InputError(f"say what to play or listen to, and where to write: {missing} is not given", path=config)
    if not duty.resume:
        refuse_to_overwrite(duty.out, replace=None)
    source = Source.of(duty)
    if duty.remote and duty.team.listen is None:
        raise InputError("rows over the network need a place where the robot listens: --listen", field="remote")
    if (address := duty.address(source.number)) is not None:
        from teamslam.cli.convoy import among

        return among(duty, source, address)
    return alone(duty, source)
