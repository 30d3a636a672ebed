"""`teamslam robot`: a robot that maps while it drives."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import MaybeWhole, Whole, whole

if TYPE_CHECKING:
    from teamslam.model import Names


def robot(
    log: Path,
    /,
    *,
    out: Path,
    robot: str | None = None,
    poses_per_piece: MaybeWhole = 100,
    heading_sigma: float | None = None,
    horizon: float = 0.0,
    landmarks: Whole = 64,
    speed: float | None = None,
    resume: bool = False,
    team: str = "team",
    listen: str | None = None,
    connect: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (),
    certificates: Path | None = None,
    members: Annotated[tuple[int, ...], Parameter(converter=whole, consume_multiple=True, negative="")] = (),
    format: str | None = None,
) -> int:
    """Map while driving: a robot's log is played row by row, as if its sensors spoke now.

    After each moment the pose of now is there with its covariance, from the rows so far alone; submaps are written as
    they close. They are those that `teamslam build` makes of the same log with the same options, to the bit.

    ```
    teamslam robot MRCLAM_Dataset6 --robot 3 --out robot-3
    teamslam robot MRCLAM_Dataset6 --robot 3 --out robot-3 --poses-per-piece 300 --speed 10
    teamslam join robot-1/submaps robot-3/submaps --out map
    teamslam robot log --robot 3 --out robot-3 --listen 10.0.0.3:7447 --connect 10.0.0.1:7447
    ```

    In the folder: `poses.csv`, a line for each moment, `submaps/`, a file for each submap, and `journal.db`, all that
    was heard: a robot that was killed at any moment goes on from it with --resume, and ends with the same submaps.

    Exit codes: 0 done; 1 some rows came too late, some piece gave no submap, or the journal is damaged or could not be
    written; 2 bad input or usage.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists.
    out
        The folder to write; it must not exist or be empty.
    robot
        The robot's name. Needed where the log is of several.
    poses_per_piece
        A submap closes after so many poses.
    heading_sigma
        A submap closes where its dead-reckoned heading is uncertain by this angle [rad].
    horizon
        How far behind the newest row another may come [s]; a row that comes later is left out, and counted.
    landmarks
        How many landmarks are carried from moment to moment at most: what a moment costs.
    speed
        How many seconds of the log go by in one. By default as fast as can be.
    resume
        Go on in a folder where a robot was stopped or killed: what its journal holds is not asked for again.
    team
        The name of the team that it exchanges submaps with.
    listen
        Where it can be reached by its team, as 192.168.1.3:7447. Without it, it drives alone. With it, it goes on
        talking when its rows have ended, until it is ended (SIGTERM, Ctrl-C); then it writes the team map into `maps/`.
        How it stands is in `status.json` all the time.
    connect
        Where some of its team can be reached; of the others it learns from them.
    certificates
        The folder with its certificate, as `teamslam keys` makes them. Without it all is in the clear.
    members
        The numbers of the robots that it listens to, where there are certificates.
    format
        The format of the log, where it cannot be told from its looks.
    """
    from teamslam.cli.console import complain, say
    from teamslam.errors import InputError
    from teamslam.io import read
    from teamslam.io.submaps.arrays import file_name, write_submap
    from teamslam.live import begun, drive, paced, replayed
    from teamslam.results import refuse_to_overwrite
    from teamslam.results.poses import PoseFile
    from teamslam.results.words import counted
    from teamslam.robot import Options
    from teamslam.robot.journal import Journal
    from teamslam.robot.rows import head_of

    if speed is not None and not 0.0 < speed < float("inf"):
        raise InputError(f"a speed is above 0, found {speed}", field="speed")
    if not resume:
        refuse_to_overwrite(out, replace=None)
    options = Options(poses_per_piece, heading_sigma, horizon, landmarks)
    dataset = read(log, format=format)
    number = _number_of(robot, dataset.names, [r for r in sorted(dataset.robots) if dataset.of_robot(r).tables])
    if listen is not None:
        from teamslam.cli.convoy import among
        from teamslam.robot.link.zenoh import Address

        return among(dataset, options, Address(team, number, listen, connect, certificates, members), out, speed)
    submaps = 0
    (out / "submaps").mkdir(parents=True, exist_ok=resume)
    with (
        Journal(out / "journal.db", head_of(dataset, number)) as journal,
        PoseFile(out / "poses.csv", dataset.names, dataset.robots[number]) as poses,
    ):
        memory = journal.recall()
        start = begun(dataset, number, options, memory)
        rest = (moment for moment in replayed(dataset, number) if moment[0] >= start.newest * dataset.names.tick_s)
        for moment in drive(start, paced(rest, speed), journal=journal):
            poses.add(moment.now)
            for submap in moment.submaps:
                write_submap(submap, out / "submaps" / file_name(submap))
            submaps += len(moment.submaps)
    for trouble in (*memory.damaged, *([journal.trouble] if journal.trouble else [])):
        complain(trouble)
    for reason in moment.unbuilt:
        complain(f"a piece gave no submap: {reason}")
    counts = moment.robot.counts
    if counts.late:
        complain(f"{counted(counts.late, 'row')} came more than {horizon:g} s behind and were left out")
    say(f"written: {out}: {counted(poses.rows, 'pose')}, {counted(submaps, 'submap')}")
    return 1 if counts.late or moment.unbuilt or memory.damaged or journal.trouble else 0


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
