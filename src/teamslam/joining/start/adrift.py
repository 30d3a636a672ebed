"""Landmarks that a search without an end carries off: along rays that became parallel as poses gave way, or that never
quite met, each step is longer than the last and gains less; or onto a sensor, from where any bearing is as good.

They were held where the search began, and are no longer where it stopped. Without them there is an optimum. A search
may also end with one so far away that nothing changes any more: its rays are parallel, and as good as true to each
other by where the poses were turned for them.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.start.triangulate import Bundle
from teamslam.model import Kind, Table, Values, is_landmark, is_pose

ENDLESS = 10.0  # times its distance: a landmark that is known no better might as well be infinitely far away
FAR = 100.0  # times the extent of all poses: what is nearer, rays of a tenth of a radian still tell from endless


def adrift(values: Values, tables: Sequence[Table], *, settled: bool) -> IntArray:
    """The landmarks of `values` that what sees them in `tables` does not hold there, all poses where they are; where
    the search has `settled`, those that it does not even tell from infinitely far ones. None that was measured in the
    world."""
    marks = [t.select(is_landmark(t.keys[:, -1])) for t in tables]
    seen = [t.select(np.asarray(values.layout.contains(t.keys).all(1))) for t in marks if not t.row.unary]
    surveyed = np.concatenate([np.zeros(0, np.int64), *(t.keys[:, 0] for t in marks if t.row.unary)])
    keys = values.layout.keys
    free = is_landmark(keys) & ~np.isin(keys, surveyed)
    if settled:
        free &= _is_beyond(values)
    found = [np.zeros(0, np.int64)]
    for kind in (Kind.POINT2, Kind.POINT3):
        own = keys[free & (values.layout.kinds == kind)]
        bundle = Bundle.of(seen, values, own, kind.dim)
        if bundle.rays:
            places = values.positions(own, kind.dim)
            held = bundle.held_at(places, ENDLESS) if settled else bundle.held_at(places)
            found.append(own[(bundle.seen > 0) & ~held])
    return np.concatenate(found)


def _is_beyond(values: Values) -> BoolArray:
    """Which variables (n,) are so far from all poses that rays to them may be as good as parallel."""
    keys = values.layout.keys
    places, poses = values.positions(keys, 3), is_pose(keys)
    if not poses.any():
        return np.zeros(len(keys), bool)
    least, most = places[poses].min(0), places[poses].max(0)
    away = np.linalg.norm(places - 0.5 * (least + most), axis=-1)
    return np.asarray(away > FAR * np.linalg.norm(most - least))
