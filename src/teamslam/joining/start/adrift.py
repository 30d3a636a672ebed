"""Landmarks that a search without an end carries off: along rays that became parallel as poses gave way, or that never
quite met, each step is longer than the last and gains less; or onto a sensor, from where any bearing is as good.

They were held where the search began, and are no longer where it stopped. Without them there is an optimum.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import IntArray
from teamslam.joining.start.triangulate import Bundle
from teamslam.model import Kind, Table, Values, is_landmark


def adrift(values: Values, tables: Sequence[Table]) -> IntArray:
    """The landmarks of `values` that what sees them in `tables` does not hold there, all poses where they are. None
    that was measured in the world."""
    marks = [t.select(is_landmark(t.keys[:, -1])) for t in tables]
    seen = [t.select(np.asarray(values.layout.contains(t.keys).all(1))) for t in marks if not t.row.unary]
    surveyed = np.concatenate([np.zeros(0, np.int64), *(t.keys[:, 0] for t in marks if t.row.unary)])
    keys = values.layout.keys
    free = is_landmark(keys) & ~np.isin(keys, surveyed)
    found = [np.zeros(0, np.int64)]
    for kind in (Kind.POINT2, Kind.POINT3):
        own = keys[free & (values.layout.kinds == kind)]
        bundle = Bundle.of(seen, values, own, kind.dim)
        if bundle.rays:
            found.append(own[(bundle.seen > 0) & ~bundle.held_at(values.positions(own, kind.dim))])
    return np.concatenate(found)
