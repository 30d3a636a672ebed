"""Several runs side by side: statistics of their errors, and what each took.

Errors are distances from the truth after one rigid alignment of the whole team. Where a run knows no truth, they are
the differences from the first run instead, which then stands for it.
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.io.files.whole import whole_file
from teamslam.model import Values
from teamslam.results.errors import truth_by_team
from teamslam.results.record import Record
from teamslam.viz import ErrorCloud

COLUMNS = ("run", "RMSE [m]", "mean", "median", "95 % below", "worst", "landmarks' RMSE [m]", "NEES / dof", "cost",
           "bytes", "seconds")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Comparison:
    """Errors of each run by its name, `rows` of a table under COLUMNS, and what the errors are from, in words."""

    clouds: Mapping[str, ErrorCloud]
    rows: list[list[str]]
    basis: str


def compared(runs: Mapping[str, Record]) -> Comparison:
    """The runs, in their order."""
    names = list(runs)
    if all(record.truth is not None for record in runs.values()):
        truths = {name: [record.truth] for name, record in runs.items()}
        basis = "distance from the truth, after one alignment of the team"
    else:
        first = [submap.all_values for submap in runs[names[0]].maps]
        truths = {name: list(first) for name in names[1:]}
        basis = f"distance from {names[0]}, after one alignment of the team: not all runs know the truth"
    clouds = {name: _cloud(runs[name], truths[name]) for name in names if name in truths}
    return Comparison(clouds, [_row(name, record, clouds.get(name)) for name, record in runs.items()], basis)


def _cloud(record: Record, truths: "list[Values | None]") -> ErrorCloud:
    robots: dict[str, list[Array]] = {}
    marks: list[Array] = [np.zeros(0)]
    for submap in record.maps:
        for truth in truths:
            if truth is None:
                continue
            known = truth_by_team(submap, truth)
            marks.append(_away(submap.all_values, known, submap.landmark_keys))
            for robot in submap.robots_in_it:
                found = _away(submap.all_values, known, submap.trajectory_keys(robot))
                robots.setdefault(submap.names.robot(robot), []).append(found)
    return ErrorCloud({name: np.concatenate(parts) for name, parts in robots.items()}, np.concatenate(marks))


def _away(values: Values, truth: Values, keys: IntArray) -> Array:
    """How far those variables (n,) that the truth knows are from it (m,) [m]."""
    shared = keys[np.asarray(truth.layout.contains(keys), bool)]
    if not len(shared):
        return np.zeros(0)
    return np.asarray(np.linalg.norm(values.positions(shared, 3) - truth.positions(shared, 3), axis=-1))


def _row(name: str, record: Record, cloud: ErrorCloud | None) -> list[str]:
    report = record.report
    errors = np.zeros(0) if cloud is None else cloud.every
    figures = [_rms(errors), *_statistics(errors), _rms(np.zeros(0) if cloud is None else cloud.landmarks)]
    return [
        name,
        *("-" if figure is None else f"{figure:.4f}" for figure in figures),
        "-" if report.get("nees_per_dof") is None else f"{report['nees_per_dof']:.3f}",
        "-" if report.get("cost") is None else f"{report['cost']:.6g}",
        f"{(report.get('exactness') or {}).get('bytes', 0):,}",
        f"{report['seconds']:.2f}",
    ]


def _rms(errors: Array) -> float | None:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else None


def _statistics(errors: Array) -> list[float | None]:
    """Mean, median, 95th percentile, worst."""
    if not len(errors):
        return [None] * 4
    return [float(errors.mean()), float(np.median(errors)), float(np.quantile(errors, 0.95)), float(errors.max())]


def write_comparison(found: Comparison, path: Path) -> None:
    """The table as CSV. OSError names the file."""
    lines = [COLUMNS, *found.rows]
    with whole_file(path) as file:
        text = io.StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows(lines)
        file.write(text.getvalue().encode("utf-8"))
