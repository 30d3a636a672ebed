"""The maps of a run coloured by a number, by name: errors where the truth is known, residuals where they are kept."""

from typing import TYPE_CHECKING

import numpy as np

from teamslam.answers.residuals import LANDMARK
from teamslam.geometry import Array, IntArray
from teamslam.results.figures import scene_of
from teamslam.results.page_rows import landmarks_of
from teamslam.results.record import Record
from teamslam.viz import Scene, Side, draw_error_map, draw_map, draw_residual_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def coloured_maps(record: Record, side: Side | None = None) -> "dict[str, Figure]":
    """New figures of each component: `map_errors`, `map_residuals`, and with a `side` the map from there."""
    figures = {}
    for number in range(len(record.maps)):
        scene, end = scene_of(record, number), "" if number == 0 else f"_{number + 1}"
        if side is not None:
            figures[f"map_from_side{end}"] = draw_map(scene, side)
        if scene.truth is not None and scene.truth.layout.contains(scene.map.keys).any():
            figures[f"map_errors{end}"] = draw_error_map(scene, side)
        places, sizes, targets = _rows(record, scene, number)
        if len(sizes):
            figures[f"map_residuals{end}"] = draw_residual_map(scene, places, sizes, targets, side)
    return figures


def _rows(record: Record, scene: Scene, number: int) -> tuple[Array, Array, IntArray]:
    """Where each row of a component was taken (n, 3), the size of its residual (n,), and the landmark seen (n,), -1 for
    none."""
    submap = scene.map
    marks = landmarks_of(submap)
    robots = {submap.names.robot(robot): robot for robot in submap.robots_in_it}
    places, sizes, targets = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.int64)]
    for found in record.rows:
        timed = np.isfinite(found.stamp_s)
        if found.component != number + 1 or found.robot not in robots or not timed.any():
            continue
        keys = submap.trajectory_keys(robots[found.robot])
        way = submap.all_values.positions(keys, 3)
        stamps = np.asarray(submap.names.stamps_s(keys), float)
        places.append(np.stack([np.interp(found.stamp_s[timed], stamps, axis) for axis in way.T], -1))
        sizes.append(found.size[timed])
        seen = np.array([marks.get(word.removeprefix(LANDMARK), -1) if word.startswith(LANDMARK) else -1
                         for word in found.targets], np.int64)  # fmt: skip
        targets.append(seen[found.target[timed]])
    return np.concatenate(places), np.concatenate(sizes), np.concatenate(targets)
