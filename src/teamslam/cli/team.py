"""`teamslam team`: a whole team that drives and exchanges, from its log, on one machine."""

import json
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from teamslam.cli.numbers import Whole
from teamslam.cli.steps import NONE, Steps

if TYPE_CHECKING:
    from teamslam.model import Dataset, Submap
    from teamslam.robot import Options
    from teamslam.robot.peer import Habits


def team(
    log: Path,
    /,
    *,
    out: Path,
    steps: Steps = NONE,
    loss: float = 0.0,
    delay: float = 0.0,
    twice: float = 0.0,
    line_rate: float | None = None,
    rate: float | None = None,
    budget: float | None = None,
    seed: Whole = 0,
    in_memory: bool = False,
    speed: float | None = None,
    kill: Whole = 0,
    format: str | None = None,
) -> int:
    """Let a team's robots drive as in its log, each with its own rows alone, and exchange submaps over poor links.

    Each robot is a process, and the links are real sockets of this machine with certificates (needs the extra
    `robots`). With --in-memory, or where links are to be poor, all is one process: its links lose, delay and repeat
    packets by a seed, in the log's time. Robots tell what they hold, ask for what they lack and pass on what they
    heard, until all hold the same; each makes the team map of it. In the folder: `report.json`, `maps/`, the parts of
    the team map, `exact/`, the same where exact rounds have put them, and of robots in processes their own folders,
    with their journals.

    ```
    teamslam team MRCLAM_Dataset6 --out team
    teamslam team MRCLAM_Dataset6 --out team --loss 0.3 --delay 0.5 --line-rate 20000
    teamslam team MRCLAM_Dataset6 --out team --speed 60 --kill 3
    ```

    Exit codes: 0 done; 1 some robot's map is another than the rest's, or something is in no map; 2 bad input or usage.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists.
    out
        The folder to write; it must not exist or be empty.
    loss
        The share of packets that are lost, in memory.
    delay
        How long a packet takes at most [s], in memory; each takes another time, so that they overtake each other.
    twice
        The share of packets that come twice, in memory.
    line_rate
        How many bytes a second a line between two robots carries, in memory. By default any number.
    rate
        How many bytes of submaps a second a robot sends to each other. By default all that it is asked for.
    budget
        How many bytes a robot sends to each other in all: what is worth most goes first, and where it is tight submaps
        go rounded or condensed. By default any number.
    seed
        Of what becomes of packets.
    in_memory
        All robots in this process, over links in memory; so it is too where these lose, delay or repeat packets.
    speed
        Of robots in processes: how many seconds of the log go by in one. By default as fast as can be.
    kill
        Of robots in processes: how often some robot is killed (SIGKILL) on the way, and started anew.
    format
        The format of the log, where it cannot be told from its looks.
    """
    from teamslam.cli.console import answer, complain, say
    from teamslam.errors import InputError
    from teamslam.fleet import fleet
    from teamslam.io import read, write_submaps
    from teamslam.results import refuse_to_overwrite, whole_folder
    from teamslam.results.fleet import report_of
    from teamslam.results.words import counted
    from teamslam.robot import Options
    from teamslam.robot.link.memory import Weather
    from teamslam.robot.peer import Habits

    refuse_to_overwrite(out, replace=None)
    options = steps.over(Options())
    weather, habits = Weather(loss, twice, 0.0, delay, line_rate), Habits(rate=rate, budget=budget)
    dataset = read(log, format=format)
    sockets = not (in_memory or weather != Weather())
    if not sockets and (speed is not None or kill):
        raise InputError(
            "--speed and --kill are for robots in processes of their own; leave out --in-memory, --loss, --delay, "
            "--twice and --line-rate"
        )
    if sockets:
        report, parts = _in_processes(log, dataset, options, habits, out, speed, kill, seed, format)
        exact: Sequence[Submap] = ()  # in the robots' folders
    else:
        found = fleet(dataset, options, habits=habits, weather=weather, seed=seed)
        report, joined = report_of(dataset, found, options)
        parts = [component.map for component in joined.components] if joined is not None else []
        exact = next(iter(found.members.values())).rounds.maps
    with nullcontext(out) if sockets else whole_folder(out) as draft:
        if parts:
            write_submaps(parts, draft / "maps")
        if exact:
            write_submaps(exact, draft / "exact")
        (draft / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    as_offline = report["equal_to_offline"] or report["in_short"] > 0  # what is in short is not there to the bit
    whole = report["maps_equal"] and as_offline and report["components"] == 1
    if not report["maps_equal"]:
        complain("the robots' maps are not equal: some lack what others hold; see 'missing' in report.json")
    if report["components"] == 0:
        complain("there is no map: no robot has rows that a submap could be made of")
    elif report["components"] > 1:
        complain(f"the map is of {report['components']} parts that nothing ties together: `teamslam join` says why")
    sent = sum(link["body_bytes"] + link["word_bytes"] for link in report["links"])
    counts = counted(len(report["robots"]), "robot", report["components"], "part", sent, "byte")
    say(f"written: {out}: {counts} sent")
    if report["in_short"]:
        say(f"{counted(report['in_short'], 'submap')} went rounded or condensed, as the links are tight")
    for what, field in (
        ("robots' position RMSE", "robot_position_rmse_m"),
        ("landmarks' position RMSE", "landmark_rmse_m"),
        ("as told at the time", "online_position_rmse_m"),
    ):
        if report[field] is not None:
            say(f"{what} {report[field]:.3f} m")
    answer(report)
    return 0 if whole else 1


def _in_processes(
    log: Path,
    dataset: "Dataset",
    options: "Options",
    habits: "Habits",
    out: Path,
    speed: float | None,
    kill: int,
    seed: int,
    format: str | None,
) -> "tuple[dict[str, Any], list[Submap]]":
    """The record of robots in processes of their own, and the parts of the team map."""
    from teamslam.cli.convoy import convoy
    from teamslam.results.fleet import report_of_folders

    rates = (("rate", habits.rate), ("budget", habits.budget), ("speed", speed))
    extra = ["--landmarks", str(options.landmarks), "--horizon", str(options.horizon_s)]
    for name, value in (("poses-per-piece", options.poses_per_piece), ("heading-sigma", options.heading_sigma),
                        *rates, ("format", format)):  # fmt: skip
        extra += [f"--{name}", str(value)] if value is not None else []
    numbers = [robot for robot in sorted(dataset.robots) if dataset.of_robot(robot).tables]
    statuses = convoy(log, dataset, numbers, out, extra, kill, seed)
    return report_of_folders(dataset, out, statuses, options)
