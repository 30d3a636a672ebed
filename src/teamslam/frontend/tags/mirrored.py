"""Tags that an optimum has the wrong way round: four corners fit two poses, nearly mirror images of each other, and a
search that starts while the way is still bent may settle at the wrong one for good.

From the poses as they are once that is over, the sightings of each tag say again at which pose it stands.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.frontend.tags.whole_poses import voted
from teamslam.geometry import BoolArray
from teamslam.model import Kind, Table, Values, among, is_landmark


def turned(values: Values, tables: Sequence[Table]) -> Values | None:
    """`values` with those tags at other poses that their sightings agree on and cost less at, all else held; None where
    there are no such.

    Law: what it gives costs less than `values`; where every tag stands as its sightings say, it gives nothing.
    """
    seen = [table.select(_stands(values, table)) for table in tables if table.model == "corners"]
    stand = [voted(table, values.poses_of(table.keys[:, 0], 3)) for table in seen]
    found = values
    for key in np.unique(np.concatenate([np.zeros(0, np.int64), *(keys for keys, _ in stand)])):
        rows = [table.select(table.keys[:, 1] == key) for table in seen]
        here = values.only(np.unique(np.concatenate([table.keys.ravel() for table in rows])))
        others = [
            here.update(Values.of({Kind.POSE3: (keys[keys == key], poses[np.flatnonzero(keys == key)])}))
            for keys, poses in stand
            if (keys == key).any()
        ]
        best = min(others, key=lambda other: _cost(other, rows))
        if _cost(best, rows) < _cost(here, rows):
            found = found.update(best.only(np.array([key])))
    return None if found is values else found


def _stands(values: Values, table: Table) -> BoolArray:
    """Which rows of a table are of landmarks that are poses."""
    poses = values.layout.keys_of(Kind.POSE3)
    return np.asarray(is_landmark(table.keys[:, -1]) & among(table.keys[:, 1], poses))


def _cost(values: Values, tables: Sequence[Table]) -> float:
    return sum(float(table.loss.cost(np.sum(table.whitened(values) ** 2, -1)).sum()) for table in tables if len(table))
