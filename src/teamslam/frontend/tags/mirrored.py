"""Tags that an optimum has the wrong way round: four corners fit two poses, nearly mirror images of each other, and a
search that starts while the way is still bent may settle at the wrong one for good.

From the poses as they are once that is over, the sightings of each tag say again at which pose it stands.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.frontend.tags.whole_poses import voted
from teamslam.geometry import IntArray
from teamslam.model import Kind, Table, Values, is_landmark


def turned(values: Values, tables: Sequence[Table]) -> Values | None:
    """`values` with those tags at other poses that their sightings agree on and cost less at, all else held; None where
    there are no such.

    Law: what it gives costs less than `values`; where every tag stands as its sightings say, it gives nothing.
    """
    seen = [table.select(is_landmark(table.keys[:, -1])) for table in tables if table.model == "corners"]
    found = values
    for key in np.unique(np.concatenate([np.zeros(0, np.int64), *(table.keys[:, 1] for table in seen)])):
        if values.layout.kinds[values.layout.index(key)] != Kind.POSE3:
            continue
        rows = [table.select(table.keys[:, 1] == key) for table in seen]
        rows = [table for table in rows if len(table)]
        one: IntArray = np.array([key])
        stands = (voted(table, values.poses_of(table.keys[:, 0], 3)) for table in rows)
        others = [values.update(Values.of({Kind.POSE3: (one, pose)})) for pose in stands]
        best = min(others, key=lambda other: _cost(other, rows))
        if _cost(best, rows) < _cost(values, rows):
            found = found.update(best.only(one))
    return None if found is values else found


def _cost(values: Values, tables: Sequence[Table]) -> float:
    return sum(float(table.loss.cost(np.sum(table.whitened(values) ** 2, -1)).sum()) for table in tables)
