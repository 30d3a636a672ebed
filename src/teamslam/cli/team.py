"""`teamslam team`: a whole team that drives and exchanges, from its log, on one machine."""

import json
from pathlib import Path

from teamslam.cli.numbers import MaybeWhole, Whole


def team(
    log: Path,
    /,
    *,
    out: Path,
    poses_per_piece: MaybeWhole = 100,
    heading_sigma: float | None = None,
    landmarks: Whole = 64,
    loss: float = 0.0,
    delay: float = 0.0,
    twice: float = 0.0,
    line_rate: float | None = None,
    rate: float | None = None,
    seed: Whole = 0,
    format: str | None = None,
) -> int:
    """Let a team's robots drive as in its log, each with its own rows alone, and exchange submaps over poor links.

    The links are within this process: they lose, delay and repeat packets by a seed, in the log's time. Robots tell
    what they hold, ask for what they lack and pass on what they heard, until all hold the same; each makes the team map
    of it. In the folder: `report.json` and `maps/`, the parts of the team map.

    ```
    teamslam team MRCLAM_Dataset6 --out team
    teamslam team MRCLAM_Dataset6 --out team --loss 0.3 --delay 0.5 --line-rate 20000
    ```

    Exit codes: 0 done; 1 some robot's map is another than the rest's, or something is in no map; 2 bad input or usage.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists.
    out
        The folder to write; it must not exist or be empty.
    poses_per_piece
        A submap closes after so many poses.
    heading_sigma
        A submap closes where its dead-reckoned heading is uncertain by this angle [rad].
    landmarks
        How many landmarks a robot carries from moment to moment at most.
    loss
        The share of packets that are lost.
    delay
        How long a packet takes at most [s]; each takes another time, so that they overtake each other.
    twice
        The share of packets that come twice.
    line_rate
        How many bytes a second a line between two robots carries. By default any number.
    rate
        How many bytes of submaps a second a robot sends to each other. By default all that it is asked for.
    seed
        Of what becomes of packets.
    format
        The format of the log, where it cannot be told from its looks.
    """
    from teamslam.cli.console import answer, complain, say
    from teamslam.fleet import fleet
    from teamslam.io import read, write_submaps
    from teamslam.results import refuse_to_overwrite, whole_folder
    from teamslam.results.fleet import report_of
    from teamslam.results.words import counted
    from teamslam.robot import Options
    from teamslam.robot.link.memory import Weather
    from teamslam.robot.peer import Habits

    refuse_to_overwrite(out, replace=None)
    options = Options(poses_per_piece, heading_sigma, 0.0, landmarks)
    weather, habits = Weather(loss, twice, 0.0, delay, line_rate), Habits(rate=rate)
    dataset = read(log, format=format)
    found = fleet(dataset, options, habits=habits, weather=weather, seed=seed)
    report, joined = report_of(dataset, found, options)
    with whole_folder(out) as draft:
        if joined is not None:
            write_submaps([component.map for component in joined.components], draft / "maps")
        (draft / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    whole = report["maps_equal"] and report["equal_to_offline"] and report["components"] == 1
    if not report["maps_equal"]:
        complain("the robots' maps are not equal: some lack what others hold; see 'missing' in report.json")
    carried = sum(link["carried_bytes"] for link in report["links"])
    parts = counted(len(found.members), "robot", report["components"], "part", carried, "byte")
    say(f"written: {out}: {parts} sent")
    for what, field in (
        ("robots' position RMSE", "robot_position_rmse_m"),
        ("landmarks' position RMSE", "landmark_rmse_m"),
        ("as told at the time", "online_position_rmse_m"),
    ):
        if report[field] is not None:
            say(f"{what} {report[field]:.3f} m")
    answer(report)
    return 0 if whole else 1
