"""What a run writes besides where it was made of recordings: tags for robots, and Table 3 where the truth is known."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.pipeline import Progress, Result
    from teamslam.results import Record


def recorded_besides(
    input: Path, result: "Result", record: "Record", out: Path, progress: "Progress", *, figures: bool = True
) -> list[str]:
    """Write them into the run's folder, the paper's figures of its experiment with them; says what they leave out.
    Nothing for any other log."""
    from teamslam.io.bags.team import Reading
    from teamslam.io.bags.team_file import is_team_file, read_team_file, write_team_file
    from teamslam.results.by_methods import by_methods
    from teamslam.results.drawing import draw_figures
    from teamslam.results.experiment import figures_of_experiment
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
    maps = by_methods(result.dataset, result.config, progress) if result.dataset.truth is not None else None
    if maps is not None and result.dataset.truth is not None:
        write_table_3(maps, result.dataset.truth, out / "table_3.csv")
    if figures:
        draw_figures(figures_of_experiment(record, maps, found, team, folder), out / "figures")
    missing = () if maps is None else maps.missing
    return [f"{d.count} {d.reason}" for d in dropped] + [f"from table_3.csv: {why}" for why in missing]
