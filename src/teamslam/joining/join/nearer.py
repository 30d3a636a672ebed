"""Rows that were taken from nearer to what they saw than the map knows how the two lie."""

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import BoolArray
from teamslam.model import Submap, Table, is_landmark
from teamslam.solver import Covariances

NEAR = 3.0  # sigmas of where the target is, seen from the sensor's pose: as far off it may be on the other side
MOST = 200  # rows looked at, a marginal of two variables each


def nearer_than_known(table: Table, map: Submap) -> BoolArray:
    """Which rows (m,) of a table of sightings name a landmark nearer to its observer than NEAR times the largest
    sigma of its place from there: in which direction it lies is open. None where the map has no covariances."""
    values, near = map.all_values, np.zeros(len(table), bool)
    if table.row.unary or len(table) > MOST or not values.layout.contains(table.keys).all():
        return near
    away = np.linalg.norm(values.positions(table.keys[:, 1], 3) - values.positions(table.keys[:, 0], 3), axis=-1)
    covariances = Covariances.of_map(map)
    try:
        for row, (observer, target) in enumerate(table.keys.tolist()):
            place = covariances.relative(values, observer, target)
            near[row] = is_landmark(target) and away[row] < NEAR * np.sqrt(np.linalg.eigvalsh(place)[-1])
    except SolveError:
        return np.zeros(len(table), bool)
    return near
