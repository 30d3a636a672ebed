"""`teamslam info`: what a log holds, what is wrong with it, and whether its robots can be joined."""

from pathlib import Path


def info(input: Path, /, *, format: str | None = None) -> int:
    """Say what a log holds and what is wrong with it, without solving anything.

    Rows for each robot and sensor, what was dropped and why, what connects the robots, what is likely to go wrong.

    ```
    teamslam info MRCLAM_Dataset6
    teamslam info my-team
    ```

    Exit codes: 0 the robots look joinable; 1 some do not; 2 bad input or usage.

    Parameters
    ----------
    input
        A log: a folder or file in any format that `teamslam convert --help` lists.
    format
        The format of the input, where it cannot be told from its looks.
    """
    from teamslam.cli.console import pairs, say, table
    from teamslam.inspection import inspect
    from teamslam.io import read

    dataset = read(input, format=format)
    found, names = inspect(dataset), dataset.names
    kinds = {2: "plane", 3: "space"}
    pairs(
        str(input),
        [
            ("robots", ", ".join(f"{names.robot(r)} ({kinds[d]})" for r, d in sorted(found.robots.items()))),
            ("poses", f"{sum(found.poses.values())}"),
            ("landmarks", f"{found.landmarks}"),
            ("truth", "yes" if found.has_truth else "no"),
            *(("read", note) for note in dataset.notes),
            ("dropped", f"{sum(d.count for d in dataset.dropped)} rows"),
            *(("", f"{d.count}: {d.reason}") for d in dataset.dropped),
        ],
    )
    start_s = min((c.start_s for c in found.counts), default=0.0)
    rows = [
        [
            names.robot(c.robot),
            c.source,
            c.model,
            str(c.rows),
            f"{c.start_s - start_s:.2f}",
            f"{c.stop_s - start_s:.2f}",
        ]
        for c in found.counts
    ]
    table("What was measured", ["robot", "source", "model", "rows", "from [s]", "to [s]"], rows)
    say(f"  time counts from {start_s:.6f} s")
    links = [
        [
            " - ".join(names.robot(r) for r in link.robots),
            str(link.landmarks),
            str(link.sightings),
            "yes" if link.holds else "not alone",
        ]
        for link in found.links
    ]
    if len(found.robots) > 1:
        table("What connects the robots", ["pair", "common landmarks", "sightings", "enough"], links)
    for hint in found.hints:
        say(f"! {hint}")
    if len(found.groups) > 1:
        say(f"{len(found.groups)} groups of robots: they will come out as separate maps")
    return 0 if len(found.groups) <= 1 else 1
