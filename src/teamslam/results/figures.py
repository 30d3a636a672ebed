"""The figures of a run, by name: map, convergence, clocks, errors, consistency; those that the run has data for."""

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teamslam.answers.residuals import LANDMARK
from teamslam.geometry import Array
from teamslam.io.files.whole import whole_file
from teamslam.model import Submap, index_of
from teamslam.results.errors import error_tracks, truth_by_team
from teamslam.results.estimated import SHOWN
from teamslam.results.record import Record
from teamslam.solver import Covariances
from teamslam.viz import (
    Estimated,
    ResidualTrack,
    Scene,
    draw_clocks,
    draw_consistency,
    draw_convergence,
    draw_errors,
    draw_map,
    draw_residuals,
    draw_residuals_by_landmark,
    saved,
)
from teamslam.viz.style import METHOD_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OBJECTIVES = {"join": "what joining adds to the cost of the submaps", "full": "cost (sum of losses)"}


def figures_of(record: Record) -> "dict[str, Figure]":
    """New figures; nothing is saved. A map for each component; errors and consistency where the truth is known."""
    return {name: figure for part in PARTS for name, figure in part(record).items()}


def _maps(record: Record) -> "dict[str, Figure]":
    return {_numbered("map", n): draw_map(scene_of(record, n)) for n in range(len(record.maps))}


def _errors(record: Record) -> "dict[str, Figure]":
    """Errors along the ways, and whether the covariances are honest about them."""
    figures: dict[str, Figure] = {}
    for n, submap in enumerate(record.maps):
        found = None if record.truth is None else error_tracks(submap, record.truth, record.covariances[n])
        if found is not None and found.tracks:
            time = "pose" if submap.names.counts else "time since the start [s]"
            look = {"time": time, "caption": f"{headline(record, n)}\n{found.frame}"}
            figures[_numbered("errors", n)] = draw_errors(found.tracks, **look)
            figures[_numbered("consistency", n)] = draw_consistency(found.tracks, **look)
    return figures


def _residuals(record: Record) -> "dict[str, Figure]":
    """Over time, and by landmark."""
    if not record.rows:
        return {}
    names = record.maps[0].names
    stamps = [r.stamp_s for r in record.rows]
    start_s = float(np.nanmin(np.concatenate(stamps))) if not names.counts else 0.0
    tracks = [ResidualTrack(r.robot, r.source, r.stamp_s - start_s, r.size, r.target, r.targets) for r in record.rows]
    look = {"caption": headline(record).partition(", part")[0]}
    figures = {"residuals": draw_residuals(tracks, time="pose" if names.counts else "time [s]", **look)}
    of_landmarks = [track for track in tracks if all(target.startswith(LANDMARK) for target in track.targets)]
    if of_landmarks:
        figures["residuals_by_landmark"] = draw_residuals_by_landmark(of_landmarks, **look)
    return figures


def clocks_figure(record: Record) -> "dict[str, Figure]":
    """`clocks`: clocks, cameras and tags on bodies, where any was estimated; else nothing."""
    names = record.maps[0].names
    start_s = min(float(names.stamps_s(m.trajectory_keys(r)[:1])[0]) for m in record.maps for r in m.robots_in_it)
    numbers, courses = [], dict[tuple[str, str], list[dict[str, Any]]]()
    for one in (record.report.get("estimated") or {}).get("unknowns", []):
        if one.get("course"):
            courses.setdefault((one["of"], one["course"]), []).append(one)
        elif one["told"] and one["windows"]:
            numbers.append(_estimated(one, one["name"], one["windows"], "stamp_s", start_s, whole=True))
    for (_, course), moments in courses.items():
        numbers.append(_estimated(moments[0], course, moments, "at_s", start_s, whole=False))
    title = f"{headline(record).partition(', part')[0]}, what was estimated beside the map"
    return {"clocks": draw_clocks(numbers, title)} if numbers else {}


def _estimated(
    one: "dict[str, Any]", name: str, dots: "Sequence[dict[str, Any]]", stamp: str, start_s: float, *, whole: bool
) -> Estimated:
    """A number that was estimated, or of which these `dots` are the course, in the unit in which it is told."""
    unit, times = SHOWN.get(one["unit"], ("", 1.0))
    stamps, values, sigmas = (np.array([dot[field] for dot in dots]) for field in (stamp, "value", "sigma"))
    return Estimated(
        f"{one['of']}: {name}" + (f" [{unit}]" if unit else ""),
        one["stated"] * times,
        stamps - start_s,
        values * times,
        sigmas * times,
        (one["value"] * times, one["sigma"] * times) if whole else None,
    )


def png_of(figure: "Figure") -> bytes:
    """A figure as a PNG file."""
    file = BytesIO()
    saved(figure, file)
    return file.getvalue()


def save(figure: "Figure", path: Path, *, dpi: float | None = None) -> None:
    """Write a figure, whole or not at all, in the type that the path ends in. OSError names the file."""
    with whole_file(path) as file:
        saved(figure, file, type=path.suffix.removeprefix("."), dpi=dpi)


def scene_of(record: Record, number: int) -> Scene:
    """The scene of one component's map, with regions of its landmarks and of the robots' first poses."""
    submap = record.maps[number]
    return Scene(
        map=submap,
        covariances=regions_of(submap, record.covariances[number]),
        truth=None if record.truth is None else truth_by_team(submap, record.truth),
        sightings=record.sightings,
        second=_second_places(record, number),
        weak=_weakest(record, number),
        method=record.method,
        title=headline(record, number),
        caption=errors_line(record.report["parts"][number]),
    )


def _second_places(record: Record, number: int) -> dict[int, Array]:
    """Where landmarks of a part could be as well, by key."""
    submap = record.maps[number]
    keys = {submap.names.landmark(int(index_of(key))): key for key in submap.landmark_keys.tolist()}
    found = record.report["parts"][number].get("second_places", [])
    return {keys[two["landmark"]]: np.array(two["position_m"]) for two in found if two["landmark"] in keys}


def _weakest(record: Record, number: int) -> tuple[Array, Array] | None:
    """Where the weakest direction of a part moves it, and by how much; None where no direction stands out."""
    found = (record.report.get("weak") or [None] * (number + 1))[number]
    arrows = [d for d in (found or {}).get("directions", ()) if d.get("places_m")]
    return (np.array(arrows[0]["places_m"]), np.array(arrows[0]["moved_m"])) if arrows else None


def regions_of(submap: Submap, covariances: Covariances) -> dict[int, Array]:
    """The covariances of a map's landmarks and of its robots' first poses, but for the one that is its frame."""
    starts = [int(submap.trajectory_keys(robot)[0]) for robot in submap.robots_in_it]
    keys = np.array([k for k in [*submap.landmark_keys.tolist(), *starts] if k != submap.base], np.int64)
    return dict(zip(keys.tolist(), covariances.blocks(keys), strict=True))


def headline(record: Record, number: int = 0) -> str:
    """What was mapped, and how: 'MRCLAM_Dataset6: submap joining'; of several components, which one."""
    inputs = [Path(name).name for name in record.report.get("inputs") or [str(record.report.get("input") or "")]]
    source = (inputs[0] or "team") + (f" and {len(inputs) - 1} more" if len(inputs) > 1 else "")
    part = f", part {number + 1} of {len(record.maps)}" if len(record.maps) > 1 else ""
    return f"{source}: {method_name(record)}{part}"


def method_name(record: Record) -> str:
    """How the map was made, in words."""
    return "exact submap joining" if record.report.get("exact") else METHOD_NAMES.get(record.method, record.method)


def errors_line(report: "dict[str, Any]") -> str:
    """The RMSE of a run or of one of its parts in words, after one rigid alignment of the whole team; '' for none."""
    parts = [
        f"{name} {report[field]:.3f} m"
        for name, field in (("robots' positions", "robot_position_rmse_m"), ("landmarks", "landmark_rmse_m"))
        if report.get(field) is not None
    ]
    return f"RMSE of {', of '.join(parts)}, after one alignment" if parts else ""


def _convergence(record: Record) -> "dict[str, Figure]":
    """The last solve of each component that took one."""
    if not any(record.costs):
        return {}
    several = len(record.maps) > 1
    lines = {
        f"part {number}" if several else method_name(record): costs
        for number, costs in enumerate(record.costs, start=1)
        if costs
    }
    exact = record.report.get("exact") or record.method == "full"
    run = {headline(record).partition(", part")[0]: lines}
    return {"convergence": draw_convergence(run, objective=OBJECTIVES["full" if exact else "join"])}


def _numbered(name: str, number: int) -> str:
    return name if number == 0 else f"{name}_{number + 1}"


PARTS: "tuple[Callable[[Record], dict[str, Figure]], ...]" = (_maps, _convergence, _residuals, clocks_figure, _errors)
"""What draws the figures of a run, in their order."""
