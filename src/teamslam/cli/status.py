"""`teamslam status`: how the robots of a team stand."""

import time
from collections import Counter
from pathlib import Path
from typing import Any

QUIET_S = 5.0  # a robot writes its status twice a second; one that is busy, less often
OLD_S = 30.0  # and this is more than that


def status(folders: tuple[Path, ...], /) -> int:
    """Who is alive, who sees whom, whose submaps each holds, how many it lacks, what went over each link, what
    waits there and when the other was last heard, whose packets were refused, and what is wrong. With --json all that
    the robots tell.

    ```
    teamslam status robot-3
    teamslam status team
    ```

    Exit codes: 0 all hold the same and nothing is wrong; 1 not so; 2 bad input or usage.

    Parameters
    ----------
    folders
        Folders that robots write (`teamslam robot --listen`), or folders of such (`teamslam team`).
    """
    from teamslam.cli.console import answer, table
    from teamslam.cli.convoy import status_of
    from teamslam.errors import InputError
    from teamslam.robot.journal import is_written

    robots: list[dict[str, Any]] = []
    for folder in folders:
        files = [folder / "status.json", *sorted(folder.glob("*/status.json"))]
        found = [
            status_of(f.parent)
            | {"age_s": time.time() - f.stat().st_mtime, "runs": is_written(f.with_name("journal.db"))}
            for f in files
            if f.exists()
        ]
        if not found:
            raise InputError("there is no status.json here or one folder deeper: no robot has written one", path=folder)
        robots += found
    same = len({robot.get("root") for robot in robots}) == 1
    for robot in robots:
        robot["is_alive"] = _alive(robot, robots)
    table(
        "robots",
        ["robot", "alive", "sees", "at", "holds", "lacks", "sent", "refused", "wrong"],
        [_row(robot) for robot in robots],
        left=1,
    )
    if any(robot.get("links") for robot in robots):
        table(
            "links",
            ["from", "to", "bodies", "bytes", "words", "bytes", "withheld", "waiting", "heard s ago", "refused"],
            [_link(robot, to, link) for robot in robots for to, link in robot.get("links", {}).items()],
            left=2,
        )
    answer(robots)
    return 0 if same and not any(_wrong(robot) or robot.get("refused_packets") for robot in robots) else 1


def _alive(robot: dict[str, Any], robots: list[dict[str, Any]]) -> str:
    """Whether a robot is there: its process holds its journal, or it said something just now, or one that did sees it
    on its link."""
    if robot.get("runs"):
        return "yes"
    if robot.get("ended"):
        return "ended"
    seen = any(robot.get("robot") in other.get("alive", ()) for other in robots if other["age_s"] < QUIET_S)
    return "yes" if seen or robot["age_s"] < QUIET_S else "no"


def _row(robot: dict[str, Any]) -> list[str]:
    links = robot.get("links", {}).values()
    return [
        str(robot.get("robot", "?")),
        robot["is_alive"] + (f", said {robot['age_s']:.0f} s ago" if robot["is_alive"] != "ended" else ""),
        ", ".join(robot.get("alive", ())) or "nobody",
        (robot.get("at") or "nowhere yet") + (", parked" if robot.get("parked") else ""),
        _holds(robot),
        str(robot.get("missing", "?")),
        f"{sum(link['body_bytes'] + link['word_bytes'] for link in links):,}",
        str(sum(robot.get("refused_packets", {}).values())),
        _wrong(robot),
    ]


def _holds(robot: dict[str, Any]) -> str:
    """How many submaps a robot holds, and whose: an id begins with its robot's name."""
    whose = Counter(held.rpartition("/")[0] for held in robot.get("holds", ()))
    each = ", ".join(f"{count} of {name}" for name, count in sorted(whose.items()))
    return f"{whose.total()}: {each}" if each else "0"


def _link(robot: dict[str, Any], to: str, link: dict[str, Any]) -> list[str]:
    """What a robot sent to another, how many bodies wait for their turn, when it last heard that robot, and how many of
    its packets it refused."""
    heard = link.get("heard_s_ago")
    return [
        str(robot.get("robot", "?")),
        to,
        str(link["bodies"]),
        f"{link['body_bytes']:,}",
        str(link["words"]),
        f"{link['word_bytes']:,}",
        str(link["withheld"]),
        str(link["waiting"]),
        "" if heard is None else f"{heard:.1f}",
        str(link["refused"]),
    ]


def _wrong(robot: dict[str, Any]) -> str:
    """What is wrong: with its disk, and with submaps that it holds and that are in no map."""
    old = robot["runs"] and robot["age_s"] > OLD_S
    silent = f"it runs and has told nothing for {robot['age_s']:.0f} s: is its disk full?" if old else ""
    return "; ".join(filter(None, [silent, robot.get("journal", ""), *robot.get("left_out", {}).values()]))
