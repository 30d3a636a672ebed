"""The paper's Table 3 of a run whose truth is known: errors of positions by full least squares, by joining, and by
joining in rounds until it is exact; each after one alignment of the whole team with the truth.

    component, method, what, count, position_rmse_m        what: robots, landmarks, or a robot by its name

Motion capture and a map have frames of their own, so errors are those after the best alignment.
"""

import json
from collections.abc import Iterator
from pathlib import Path

from teamslam.io.files.text import write_text
from teamslam.metrics import Report, score
from teamslam.model import Values
from teamslam.results.by_methods import ByMethods


def write_table_3(found: ByMethods, truth: Values, path: Path) -> None:
    """The errors of maps by all methods."""
    lines = ["component,method,what,count,position_rmse_m"]
    for method, joined in found.maps.items():
        for number, component in enumerate(joined.components, 1):
            report = score(component.map, truth)
            lines += [f"{number},{method},{','.join(cells)}" for cells in _rows(report)]
    write_text(path, "\n".join([*lines, ""]))


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
