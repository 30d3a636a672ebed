"""The run folder. It is written beside its place and moved there when it is whole: never half a result.

What is in it:

    maps/              the maps, one for each component, as teamslam.read_submaps opens them
    map.npz            the map of the first component as plain numpy arrays (see `archive`)
    trajectories.csv   landmarks.csv   team.csv      estimates with covariances, for spreadsheets and pandas
    tum/               each robot's way, for evo and others
    figures/           the map with its ellipses and the truth, convergence, errors over time, consistency
    report.json        figures for scripts            config.toml     every option as used
    history.csv        the solver's steps             log.npz         truth and sightings, to draw from later
"""

import csv
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from teamslam.config import Config, write_config
from teamslam.errors import InputError
from teamslam.io import read_submaps, write_submaps
from teamslam.io.files.whole import beside
from teamslam.io.maps.tum import write_trajectories
from teamslam.model import Layout, Values
from teamslam.pipeline import Result
from teamslam.results.archive import write_archive
from teamslam.results.figures import figures_of
from teamslam.results.record import Record
from teamslam.results.tables import (
    read_history,
    write_history,
    write_landmarks,
    write_team,
    write_trajectory_table,
)
from teamslam.solver import Covariances

FIGURE_FORMAT = "png"


def write_run(result: Result, folder: str | Path, *, replace: bool = False, figures: bool = True) -> Record:
    """Write a finished run and return what was kept.

    Raises InputError where the folder is there already and not empty, unless it is a run folder to `replace`.
    """
    folder = Path(folder)
    refuse_to_overwrite(folder, replace=replace)
    record = Record.of(result)
    with whole_folder(folder) as draft:
        write_record(record, result.config, draft, figures=figures)
    return record


def write_record(record: Record, config: Config, folder: Path, *, figures: bool = True) -> None:
    """All files of a run, into an existing folder."""
    write_submaps(record.maps, folder / "maps")
    write_archive(record.maps[0], folder / "map.npz")
    write_trajectory_table(record, folder / "trajectories.csv")
    write_landmarks(record, folder / "landmarks.csv")
    write_team(record, folder / "team.csv")
    write_history(record.history, folder / "history.csv")
    write_config(config, folder / "config.toml")
    (folder / "report.json").write_text(json.dumps(record.report, indent=2) + "\n", encoding="utf-8")
    _write_log(record, folder / "log.npz")
    _write_tum(record, folder / "tum")
    if figures:
        (folder / "figures").mkdir()
        for name, figure in figures_of(record).items():
            figure.savefig(folder / "figures" / f"{name}.{FIGURE_FORMAT}")


def read_run(folder: str | Path) -> Record:
    """The record in a run folder. Raises InputError naming the file that is missing or damaged."""
    folder = Path(folder)
    for name in ("maps", "report.json", "history.csv", "log.npz"):
        if not (folder / name).exists():
            raise InputError(
                f"no {name} in it; expected a run folder as `teamslam run INPUT --out DIR` writes", path=folder
            )
    truth, sightings = _read_log(folder / "log.npz")
    try:
        history = read_history(folder / "history.csv")
    except (ValueError, IndexError, csv.Error) as error:
        raise InputError(f"not a table of solver steps: {error}", path=folder / "history.csv") from None
    maps = tuple(read_submaps(folder / "maps"))
    return Record(maps, tuple(map(Covariances.of_map, maps)), truth, sightings, history, read_report(folder))


def read_report(folder: str | Path) -> dict[str, Any]:
    """What report.json says. Raises InputError where it is not what a run wrote."""
    path = Path(folder) / "report.json"
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"not a report: {error}", path=path) from None
    if not isinstance(report, dict) or "method" not in report:
        raise InputError("not a report: no field 'method'", path=path)
    return report


def is_run(path: str | Path) -> bool:
    """True for a folder that holds a run."""
    return (Path(path) / "report.json").is_file() and (Path(path) / "maps").is_dir()


# --- whole or not at all --------------------------------------------------------------------------------------------


def refuse_to_overwrite(folder: Path, *, replace: bool | None) -> None:
    """Raise InputError where writing to `folder` would destroy something that is not an earlier run.

    `replace`: whether an earlier run may be replaced; None where the command knows no such thing.
    """
    if folder.is_dir() and any(folder.iterdir()):
        if not replace:
            cure = "choose another, or empty it" if replace is None else "choose another, or replace it with --force"
            raise InputError(f"the output folder is not empty; {cure}", path=folder)
        if not is_run(folder):
            raise InputError("the output folder holds something that is no run; it is left alone", path=folder)
    elif folder.exists() and not folder.is_dir():
        raise InputError("the output is a file; expected a folder to make", path=folder)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A draft folder that takes the place of `folder` once everything in it is written, and vanishes on any error."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        (draft := beside(folder)).mkdir()
    except OSError as error:
        raise InputError(f"the output folder cannot be made: {error.strerror or error}", path=folder) from None
    try:
        yield draft
        if folder.exists():
            shutil.rmtree(folder)
        draft.replace(folder)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


# --- the log's part -------------------------------------------------------------------------------------------------


def _write_log(record: Record, path: Path) -> None:
    truth = record.truth
    empty = np.zeros(0, np.int64)
    np.savez_compressed(
        path,
        sightings=record.sightings,
        has_truth=np.array(truth is not None),
        truth_keys=truth.layout.keys if truth else empty,
        truth_kinds=truth.layout.kinds if truth else empty,
        truth_state=truth.state if truth else np.zeros(0),
    )


def _read_log(path: Path) -> tuple[Values | None, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as log:
            sightings = np.asarray(log["sightings"], np.int64)
            if not log["has_truth"]:
                return None, sightings
            return Values(Layout(log["truth_keys"], log["truth_kinds"]), log["truth_state"]), sightings
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(f"not the log of a run: {error}", path=path) from None


def _write_tum(record: Record, folder: Path) -> None:
    for number, submap in enumerate(record.maps):
        write_trajectories(submap.all_values, submap.names, folder if number == 0 else folder / f"part_{number + 1}")
