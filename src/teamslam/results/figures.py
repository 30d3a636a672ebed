"""The figures of a run, by name: map, convergence, errors, consistency; those that the run has data for."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from teamslam.geometry import Array
from teamslam.results.errors import error_tracks, truth_by_team
from teamslam.results.record import Record
from teamslam.results.tables import submap_robots
from teamslam.viz import Scene, draw_consistency, draw_convergence, draw_errors, draw_map
from teamslam.viz.style import METHOD_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figures_of(record: Record) -> "dict[str, Figure]":
    """New figures; nothing is saved. A map for each component; errors and consistency where the truth is known."""
    figures = {_numbered("map", n): draw_map(scene_of(record, n)) for n in range(len(record.maps))}
    if record.costs:
        figures["convergence"] = draw_convergence({headline(record): {record.method: record.costs}})
    if record.truth is not None:
        tracks = error_tracks(record.maps[0], record.truth, record.covariances[0])
        if tracks:
            figures["errors"] = draw_errors(tracks, caption=f"{headline(record)}; {errors_line(record)}")
            figures["consistency"] = draw_consistency(tracks, caption=headline(record))
    return figures


def scene_of(record: Record, number: int) -> Scene:
    """The scene of one component's map, with regions of its landmarks and of the robots' first poses."""
    submap = record.maps[number]
    starts = [int(submap.trajectory_keys(robot)[0]) for robot in submap_robots(submap)]
    keys = np.array([k for k in [*submap.landmark_keys.tolist(), *starts] if k != submap.base], np.int64)
    regions: dict[int, Array] = dict(zip(keys.tolist(), record.covariances[number].blocks(keys), strict=True))
    return Scene(
        map=submap,
        covariances=regions,
        truth=None if record.truth is None else truth_by_team(submap, record.truth),
        sightings=record.sightings,
        method=record.method,
        title=f"{headline(record)}" + (f", part {number + 1} of {len(record.maps)}" if len(record.maps) > 1 else ""),
        caption=errors_line(record) if record.truth is not None else "",
    )


def headline(record: Record) -> str:
    """What was mapped, and how: 'MRCLAM_Dataset6: submap joining'."""
    source = Path(str(record.report.get("input") or "")).name or "Team"
    method = "exact submap joining" if record.report.get("exact") else METHOD_NAMES.get(record.method, record.method)
    return f"{source[:1].upper()}{source[1:]}: {method}"


def errors_line(record: Record) -> str:
    """The RMSE of the run in words, after one rigid alignment of the whole team."""
    parts = [
        f"{name} {record.report[field]:.3f} m"
        for name, field in (("robots' positions", "robot_position_rmse_m"), ("landmarks", "landmark_rmse_m"))
        if record.report.get(field) is not None
    ]
    return f"RMSE of {', of '.join(parts)}" if parts else ""


def _numbered(name: str, number: int) -> str:
    return name if number == 0 else f"{name}_{number + 1}"
