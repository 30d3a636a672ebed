"""The paper's Table 3 of a run whose truth is known: errors of positions by full least squares, by joining, and by
joining in rounds until it is exact; each after one alignment of the whole team with the truth.

    component, method, what, count, position_rmse_m        what: robots, landmarks, or a robot by its name

Motion capture and a map have frames of their own, so errors are those after the best alignment. All three are made by
the noise as it is stated.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from teamslam.config import Config
from teamslam.errors import SolveError
from teamslam.io.files.text import write_text
from teamslam.metrics import Report, score
from teamslam.model import Dataset
from teamslam.pipeline import Clock, Progress, mapped

METHODS = ("full", "join", "exact")


def write_table_3(dataset: Dataset, config: Config, path: Path, progress: Progress | None = None) -> tuple[str, ...]:
    """Map a log whose truth is known by each of METHODS, and write their errors; returns the methods that gave no map,
    with the reason."""
    assert dataset.truth is not None
    clock = Clock(progress)
    lines, missing = ["component,method,what,count,position_rmse_m"], []
    for method in METHODS:
        name = "full" if method == "full" else "join"
        options = replace(config, method=name, join=replace(config.join, exact=method == "exact"))
        try:
            _, _, joined = mapped(dataset, options, None, None, clock)
        except SolveError as error:
            missing.append(f"{method}: {error}")
            continue
        for number, component in enumerate(joined.components, 1):
            report = score(component.map, dataset.truth)
            lines += [f"{number},{method},{','.join(cells)}" for cells in _rows(report)]
    write_text(path, "\n".join([*lines, ""]))
    return tuple(missing)


def _rows(report: Report) -> Iterator[tuple[str, str, str]]:
    found = report.accuracy
    if found is None:
        return
    for what, count, error in (
        ("robots", found.poses, found.robot_position_rmse_m),
        ("landmarks", found.landmarks, found.landmark_rmse_m),
        *((json.dumps(f"robot {robot.robot}"), robot.poses, robot.position_rmse_m) for robot in found.robots),
    ):
        if error is not None:
            yield what, str(count), f"{error:.6f}"
