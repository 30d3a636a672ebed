"""What a run writes besides where it was made of recordings: tags for robots, and Table 3 where the truth is known."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.pipeline import Progress, Result
    from teamslam.results import Record


def recorded_besides(input: Path, result: "Result", record: "Record", out: Path, progress: "Progress") -> list[str]:
    """Write them into the run's folder; says what they leave out. Nothing for any other log."""
    from teamslam.io.bags.team import Reading
    from teamslam.io.bags.team_file import is_team_file, read_team_file, write_team_file
    from teamslam.results.frames import write_frames
    from teamslam.results.reprojection import reprojected, write_reprojection
    from teamslam.results.table_3 import write_table_3
    from teamslam.results.tagged import write_tags

    if not is_team_file(input):
        return []
    others = result.config.read.get("recordings", [])
    team, folder = (
        read_team_file(input).with_recordings(others if isinstance(others, list) else [], input),
        input.parent,
    )
    reading = result.dataset.unknowns
    if result.unknowns is not None and isinstance(reading, Reading):  # clocks and cameras as they were found
        team = reading.file
        write_team_file(team, out / "team_found.toml")
    dropped = write_tags(record, team, out / "tags")
    found = reprojected(result.dataset, record.maps, team, folder)
    if found:
        write_reprojection(found, out / "tags" / "reprojection.csv")
        write_frames(found, team, folder, out / "frames")
    missing: tuple[str, ...] = ()
    if result.dataset.truth is not None:
        missing = write_table_3(result.dataset, result.config, out / "table_3.csv", progress)
    return [f"{d.count} {d.reason}" for d in dropped] + [f"from table_3.csv: {why}" for why in missing]
