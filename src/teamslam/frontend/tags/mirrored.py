"""Tags that an optimum has the wrong way round: four corners fit two poses, nearly mirror images of each other, and a
search that starts while the way is still bent may settle at the wrong one for good.

From the poses as they are once that is over, the sightings of each tag say again at which pose it stands, and at which
they agree best of those that are turned against it. What they agree on is the pose of one sighting, and errs as that
does: of two poses of a tag that was seen often and from afar it would cost more than the wrong one at its optimum. So
each is brought to its own optimum first, all else held.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.frontend.tags.whole_poses import voted_but
from teamslam.geometry import BoolArray, Pose
from teamslam.geometry.resection import mirrored
from teamslam.model import Kind, Table, Values, among, is_landmark
from teamslam.solver import Options, System, optimise

TURNED = 0.1  # [rad]: a pose that is turned by more is another
WORTH = 2.0  # times the cost at the pose of before: what a pose may cost that is worth an optimum,
MORE = 50.0  # and so much more
FEW = Options(max_iterations=15, decrement=0.1, elsewhere=False)


def turned(values: Values, tables: Sequence[Table]) -> Values | None:
    """`values` with those tags at other poses that their sightings agree on and cost less at, all else held; None where
    there are no such.

    Law: what it gives costs less than `values`; where every tag stands as its sightings say, it gives nothing.
    """
    seen = [table.select(stands(values, table)) for table in tables if table.model == "corners"]
    stand = []
    for table in seen:
        eyes, known = (values.poses_of(keys, 3) for keys in table.keys.T)
        stand += [voted_but(table, eyes, None, 0.0), voted_but(table, eyes, known, TURNED)]
    found = values
    for key in np.unique(np.concatenate([np.zeros(0, np.int64), *(keys for keys, _, _ in stand)])):
        rows = [table.select(table.keys[:, 1] == key) for table in seen]
        here = values.only(np.unique(np.concatenate([table.keys.ravel() for table in rows])))
        cost = cost_of(here, rows)
        others = [
            here.update(Values.of({Kind.POSE3: (keys[keys == key], poses[np.flatnonzero(keys == key)])}))
            for keys, any_, poses in stand
            if any_[keys == key].any()
        ]
        others = [settled_alone(other, rows, key) for other in others if cost_of(other, rows) < WORTH * cost + MORE]
        best = min([here, *others], key=lambda other: cost_of(other, rows))
        if cost_of(best, rows) < cost:
            found = found.update(best.only(np.array([key])))
    return None if found is values else found


def others_of(values: Values, table: Table) -> Iterator[Pose]:
    """What the sightings of a tag agree on that is turned against how it stands, and that leaned the other way, as the
    sighting in the middle has it."""
    eyes, known = (values.poses_of(keys, 3) for keys in table.keys.T)
    _, some, pose = voted_but(table, eyes, known, TURNED)
    if some.all():
        yield pose
    eye = eyes[[len(table) // 2]]
    eye = eye if table.sensor is None else eye @ table.sensor.lift(3)[None]
    yield eye @ mirrored(eye.inverse() @ known[:1])


def settled_alone(values: Values, rows: Sequence[Table], key: np.int64) -> Values:
    """A tag at its optimum by some rows, all else held; where it was, where they do not say."""
    keys = values.layout.keys
    try:
        system = System(values.layout, tables=[table for table in rows if len(table)], fixed=keys[keys != key])
        return optimise(system, values, FEW).values
    except SolveError:
        return values


def stands(values: Values, table: Table) -> BoolArray:
    """Which rows of a table are of landmarks that are poses."""
    poses = values.layout.keys_of(Kind.POSE3)
    return np.asarray(is_landmark(table.keys[:, -1]) & among(table.keys[:, 1], poses))


def cost_of(values: Values, tables: Sequence[Table]) -> float:
    """What rows cost at `values`."""
    return sum(table.cost(values) for table in tables)
