"""`teamslam info`: what a log holds, what is wrong with it, and whether its robots can be joined."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.inspection import Inspection
    from teamslam.io.bags import Contents
    from teamslam.model import Names


def info(*inputs: Path, format: str | None = None) -> int:
    """Say what a log holds and what is wrong with it, without making the map.

    Rows for each robot and sensor, what was dropped and why, what connects the robots, what is likely to go wrong.

    ```
    teamslam info MRCLAM_Dataset6
    teamslam info my-team
    teamslam info drive.bag                 # a recording of ROS: what is in it, and a first team file
    teamslam info one.bag two.bag           # those of a team, or the parts of one that was split
    ```

    Exit codes: 0 the robots look joinable; 1 some do not; 2 bad input or usage.

    Parameters
    ----------
    inputs
        A log: a folder or file in any format that `teamslam convert --help` lists; or a recording (ROS 1 bag, ROS 2
        folder, .mcap, .db3), or several: the parts of one, or those of a team.
    format
        The format of the input, where it cannot be told from its looks.
    """
    from teamslam.cli.codes import DONE, PARTLY
    from teamslam.cli.console import answer, pairs, progress_bar, say, table
    from teamslam.errors import InputError, in_words
    from teamslam.inspection import inspect
    from teamslam.io import read_log
    from teamslam.io.bags import is_recording
    from teamslam.io.formats import MISSING
    from teamslam.results.words import counted

    if inputs and format is None and all(map(is_recording, inputs)):
        return _recordings(inputs)
    for missing in (input for input in inputs if not input.exists()):
        raise InputError(MISSING, path=missing)
    if len(inputs) != 1:
        raise InputError(f"{len(inputs) or 'no'} inputs; give one log, or recordings of ROS")
    (input,) = inputs
    with progress_bar() as progress:
        dataset = read_log(input, format=format, progress=progress)
    found, names = inspect(dataset), dataset.names
    kinds = {2: "plane", 3: "space"}
    pairs(
        str(input),
        [
            ("robots", ", ".join(f"{names.robot(r)} ({kinds[d]})" for r, d in sorted(found.robots.items())) or "none"),
            ("poses", f"{sum(found.poses.values()):,}"),
            ("landmarks", f"{found.landmarks:,}"),
            ("truth", "yes" if found.has_truth else "no"),
            *(("read", note) for note in dataset.notes),
            ("dropped", counted(sum(d.count for d in dataset.dropped), "row")),
            *(("", f"{d.count}: {d.reason}") for d in dataset.dropped),
        ],
    )
    if found.counts:
        table("What was measured", *_measured(found, names), left=3)
    if len(found.robots) > 1:
        links = [
            [
                " - ".join(names.robot(r) for r in link.robots),
                str(link.landmarks),
                str(link.sightings),
                "yes" if link.holds else "not alone",
            ]
            for link in found.links
        ]
        table("What connects the robots", ["pair", "common landmarks", "sightings", "enough"], links)
    for hint in found.hints:
        say(in_words(f"! {hint}"))
    if len(found.groups) > 1:
        say(f"{len(found.groups)} groups of robots, as far as counting tells: expect as many maps")
    answer(
        found.to_dict(names)
        | {"input": str(input), "read": dataset.notes, "dropped": [vars(d) for d in dataset.dropped]}
    )
    return DONE if len(found.groups) <= 1 else PARTLY


def _recordings(paths: tuple[Path, ...]) -> int:
    """What recordings hold, and the team file that they suggest."""
    from teamslam.cli.codes import DONE, PARTLY
    from teamslam.cli.console import answer, say
    from teamslam.io.bags import contents, parts_beside, proposal, recordings_of

    several = [contents(parts) for parts in (recordings_of(paths) if len(paths) > 1 else [paths])]
    told = [_told(found) for found in several]
    if len(paths) == 1 and len(parts := parts_beside(paths[0])) > 1:
        all_of_it = " ".join(map(str, parts))
        say(f"! it seems to be a part of a recording that was split; all of it: teamslam info {all_of_it}")
    if not any(found.of_role(role) for found in several for role in ("tags", "tag poses", "image")):
        say("! neither tags nor images: nothing in it can be mapped")
    else:
        say(f"\nA first team file; check the lines that end in '# ?':\n\n{proposal(*several)}")
    answer(told[0] if len(told) == 1 else {"recordings": told})
    return PARTLY if any(found.dropped for found in several) else DONE


def _told(found: "Contents") -> dict[str, object]:
    """Say what a recording holds; the same as a record."""
    from teamslam.cli.console import pairs, say, table
    from teamslam.results.words import counted

    title = " ".join(map(str, found.paths))
    messages = sum(len(topic.stamps_s) for topic in found.topics)
    pairs(
        title,
        [
            ("messages", f"{messages:,}"),
            ("time", f"{found.stop_s - found.start_s:.1f} s, from {found.start_s:.3f} s" if messages else "none"),
            ("dropped", counted(sum(d.count for d in found.dropped), "message")),
            *(("", f"{d.count}: {d.reason}") for d in found.dropped),
        ],
    )
    rows = [
        [
            topic.name,
            " and ".join(topic.types),
            topic.role or "not used",
            f"{len(topic.stamps_s):,}",
            *([f"{topic.rate_hz:.2f}"] if topic.rate_hz == topic.rate_hz else ["-"]),
            f"{len(topic.gaps_s)}, {topic.gaps_s.max():.2f} s" if len(topic.gaps_s) else "none",
        ]
        for topic in found.topics
    ]
    table("Topics", ["topic", "type", "used as", "messages", "rate [Hz]", "gaps, the longest"], rows, left=3)
    for topic in found.topics:
        if topic.steps_back:
            say(f"! {topic.name}: {counted(topic.steps_back, 'stamp')} earlier than the one before")
    return {
        "input": title,
        "messages": messages,
        "topics": [
            {
                "topic": t.name,
                "types": list(t.types),
                "used_as": t.role,
                "messages": len(t.stamps_s),
                "rate_hz": t.rate_hz,
            }
            for t in found.topics
        ],
        "dropped": [vars(dropped) for dropped in found.dropped],
    }


def _measured(found: "Inspection", names: "Names") -> tuple[list[str], list[list[str]]]:
    """The table of what was measured: from the first pose concerned to the last, counted from the log's first."""
    start = min((c.start_s for c in found.counts if c.rows and isfinite(c.start_s)), default=0.0)
    digits, unit = (0, "") if names.counts else (2, " [s]")
    rows = [
        [names.robot(c.robot), f"{c.source}, {c.sensor}" if c.sensor else c.source, c.model, f"{c.rows:,}"]
        + [f"{stamp - start:.{digits}f}" if c.rows and isfinite(stamp) else "" for stamp in (c.start_s, c.stop_s)]
        for c in found.counts
    ]
    zero = f"pose {start:.0f}" if names.counts else f"{start:.6f} s"
    return ["robot", "source", "model", "rows", f"from{unit}", f"to{unit}, counted from {zero}"], rows
