"""The run folder. It is written beside its place and moved there when it is whole: never half a result.

What is in it:

    maps/              the maps, one for each component, as teamslam.read_submaps opens them
    map.npz            the maps of all components as plain numpy arrays (see `archive`)
    trajectories.csv   landmarks.csv   team.csv      estimates with covariances, for spreadsheets and pandas
                       (of poses heading_rad, or where any robot or tag is a pose in space z_m and qw, qx, qy, qz;
                       of a landmark its place: how a tag is turned stands in map.npz, and in map.csv of
                       `teamslam convert DIR map.csv`)
    tum/               each robot's way, for evo and others
    figures/           the map with its ellipses and the truth, convergence, residuals, errors over time, consistency;
                       of recordings also figures 5 to 7 of the paper (see `experiment`)
    report.html        all of it as one page: open it in a browser
    report.json        figures for scripts            config.toml     every option as used
    residuals.csv      what every row of the log leaves at the map (see `residuals`)
    history.csv        the solver's steps             log.npz         truth and sightings, to draw from later
    tags/              of recordings: the tags for other programs (see `tagged`)
    frames/            of recordings with images: the worst and the best, with corners as seen and as mapped
    team_found.toml    of recordings: the team file with clocks and cameras as they were found
    table_3.csv        of recordings with truth: errors by full least squares, join and exact join
"""

import csv
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from teamslam.config import Config, write_config
from teamslam.errors import InputError, SolveError
from teamslam.io import write_submaps
from teamslam.io.files.npz import read_arrays, write_arrays
from teamslam.io.files.whole import named
from teamslam.io.maps.tum import write_trajectories
from teamslam.io.submaps import arrays as submaps
from teamslam.model import A_PATH, Layout, Submap, Values, expect
from teamslam.pipeline import Result
from teamslam.results.archive import write_archive
from teamslam.results.drawing import drawing
from teamslam.results.page import PAGE
from teamslam.results.record import Record
from teamslam.results.residuals import residuals_in, write_residuals
from teamslam.results.tables import (
    read_histories,
    write_histories,
    write_landmarks,
    write_team,
    write_trajectory_table,
)
from teamslam.results.whole import refuse_to_overwrite, whole_folder
from teamslam.solver import Covariances, side_by_side


def write_run(result: Result, folder: str | Path, *, replace: bool = False, figures: bool = True) -> Record:
    """Write a finished run and return what was kept. The page and `figures` come last, when the rest is in its place.

    Raises InputError where the folder is there already and not empty, unless it is a run folder to `replace`; OSError
    names the file that cannot be written.
    """
    expect(result, Result, "a run (of ts.run)")
    expect(folder, str | Path, A_PATH)
    folder = Path(folder)
    refuse_to_overwrite(folder, replace=replace, ours=OURS)
    record = Record.of(result)
    if not figures:
        write_record(record, result.config, folder)
        return record
    with drawing(record, result.config) as drawn:
        write_record(record, result.config, folder)
        drawn(folder)
    return record


def write_record(record: Record, config: Config, folder: Path) -> None:
    """All files of a run but its page and figures, into a new folder or in place of what is there.

    They are written side by side: much of it is packing and disk, which need no Python.
    """

    def write(name: str) -> None:
        with named(draft / name):
            FILES[name](record, draft / name)

    record.with_covariances()
    with whole_folder(folder) as draft:
        with named(draft / "config.toml"):
            write_config(config, draft / "config.toml")
        side_by_side(write, [*FILES])


def _write_report(record: Record, path: Path) -> None:
    path.write_text(json.dumps(known(record.report), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def known(report: Any) -> Any:
    """A report as JSON can hold it: what is not finite is null."""
    if isinstance(report, Mapping):
        return {key: known(value) for key, value in report.items()}
    if isinstance(report, list | tuple):
        return [known(value) for value in report]
    return None if isinstance(report, float) and not math.isfinite(report) else report


def read_run(folder: str | Path) -> Record:
    """The record in a run folder. Raises InputError naming the file that is missing or damaged."""
    expect(folder, str | Path, A_PATH)
    folder = Path(folder)
    for name in ("maps", "report.json", "history.csv", "log.npz"):
        if not (folder / name).exists():
            raise InputError(
                f"no {name} in it; expected a run folder as `teamslam run INPUT --out DIR` writes", path=folder
            )
    report = read_report(folder)
    truth, sightings = _read_log(folder / "log.npz")
    maps = tuple(submaps.read(folder / "maps", prove=False))
    try:
        histories = read_histories(folder / "history.csv", len(maps))
    except (ValueError, IndexError, csv.Error) as error:
        raise InputError(f"not a table of solver steps: {error}", path=folder / "history.csv") from None
    return Record(maps, _covariances(maps, folder / "maps"), truth, sightings, histories, report, folder=folder)


def _covariances(maps: Sequence[Submap], path: Path) -> tuple[Covariances, ...]:
    """Those of each map; their factors prove that they are maps."""
    try:
        return tuple(Covariances.of_map(found).determined() for found in maps)
    except SolveError:
        raise InputError("the information is not positive definite: the map is not determined", path=path) from None


def with_residuals(record: Record, folder: str | Path) -> Record:
    """A record with the residuals that lie in its folder; as it is where there are none. InputError where the file is
    another's."""
    rows = residuals_in(Path(folder))
    return replace(record, rows=rows) if rows else record


def read_report(folder: str | Path) -> dict[str, Any]:
    """What report.json says. Raises InputError where it is not what a run wrote."""
    path = Path(folder) / "report.json"
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"not a report: {error}", path=path) from None
    if not isinstance(report, dict) or "method" not in report:
        raise InputError("not a report: no field 'method'", path=path)
    if not isinstance(report.get("parts"), list):
        raise InputError("written by another version of teamslam: no field 'parts'; run it again", path=path)
    return report


# --- the log's part -------------------------------------------------------------------------------------------------


def _write_log(record: Record, path: Path) -> None:
    truth = record.truth
    empty = np.zeros(0, np.int64)
    arrays = {
        "sightings": record.sightings,
        "has_truth": np.array(truth is not None),
        "truth_keys": truth.layout.keys if truth else empty,
        "truth_kinds": truth.layout.kinds if truth else empty,
        "truth_state": truth.state if truth else np.zeros(0),
    }
    write_arrays(path, arrays)


def _read_log(path: Path) -> tuple[Values | None, np.ndarray]:
    try:
        log = read_arrays(path)
        sightings = np.asarray(log["sightings"], np.int64)
        if not log["has_truth"]:
            return None, sightings
        return Values(Layout(log["truth_keys"], log["truth_kinds"]), log["truth_state"]), sightings
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(f"not the log of a run: {error}", path=path) from None


def _write_tum(record: Record, folder: Path) -> None:
    for number, submap in enumerate(record.maps):
        write_trajectories(submap.all_values, submap.names, folder if number == 0 else folder / f"part_{number + 1}")


FILES: dict[str, Callable[[Record, Path], object]] = {
    "maps": lambda record, path: write_submaps(record.maps, path),
    "map.npz": lambda record, path: write_archive(record.maps, path),
    "trajectories.csv": write_trajectory_table,
    "landmarks.csv": write_landmarks,
    "team.csv": write_team,
    "residuals.csv": lambda record, path: write_residuals(record.rows, path),
    "history.csv": lambda record, path: write_histories(record.histories, path),
    "log.npz": _write_log,
    "tum": _write_tum,
    "report.json": _write_report,
}
OURS = (*FILES, "config.toml", "figures", PAGE, "tags", "frames", "table_3.csv", "team_found.toml")
"""What a run writes; nothing else is ever replaced."""
