"""What a map knows of the landmarks about a pose, as the Gaussian that a filter begins with.

The map is that of all closed pieces (and of the team, where heard); the filter goes on from the pose at which the open
rows begin. Each row counts once: closed ones in the map, open ones in the filter. So the pose of now is that of the
joint estimate of all rows to first order, as far as the landmarks go that are carried along: a marginal of the map is
exact, and a landmark that is left out is not known.
"""

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Submap, Values
from teamslam.model.layout import KIND_SIZE, rows_of
from teamslam.robot.ahead import Ahead
from teamslam.robot.filter import Filter
from teamslam.robot.order import Order
from teamslam.solver import Covariances

AHEAD = 4  # landmarks that may be told of on the way, for each that may be carried at a time


def outlook(known: Submap, at: int, landmarks: int) -> Filter | None:
    """The filter at a pose of a map, with at most so many landmarks: those nearest to it over the ground; None where
    the map does not hold that pose. Raises SolveError where the map leaves something open."""
    values = known.all_values
    if not values.layout.contains(at):
        return None
    keys = np.concatenate([[at], _nearest(values, at, known.landmark_keys, AHEAD * landmarks)])
    places = values.layout.index(keys)
    order = Order(keys, values.layout.kinds[places], np.zeros(len(keys), bool))
    state = values.state[rows_of(values.layout.state_start[places], KIND_SIZE[order.kinds])]
    covariance = np.zeros((int(order.unknowns[-1]),) * 2)
    free = keys != known.base
    if free.any():
        columns = order.columns(np.flatnonzero(free))
        covariance[np.ix_(columns, columns)] = Covariances.of_map(known).joint(keys[free])
    return Filter.begun(Ahead(known.base, order, state, covariance))


def _nearest(values: Values, at: int, marks: IntArray, most: int) -> IntArray:
    away = values.positions(marks, 2) - values.positions(np.array([at]), 2)
    return marks[np.sort(np.argsort(np.sum(away**2, -1), kind="stable")[:most])]
