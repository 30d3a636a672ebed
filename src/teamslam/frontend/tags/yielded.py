"""Tags that an optimum has the wrong way round, and to which the poses that saw them have bent: those of a camera that
is carried by hand past a tag by itself fit it however it stands, and others give way by what hardly ties them. So a tag
that is turned with all else held costs more (see `mirrored`), and less once what saw it gives way.

    found:   what the sightings of a tag agree on that is turned against how it stands, and that leaned the other way
    held:    of those who saw the tag, some saw others, too; by them alone it may stand so
    settled: that tag and the poses that saw it at the optimum of all rows that touch these poses, all else held

All that is beside them stays, so what costs less here costs less in the whole map.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.frontend.tags.mirrored import MORE, WORTH, cost_of, others_of, settled_alone, stands
from teamslam.geometry import IntArray
from teamslam.model import Kind, Table, Values, among
from teamslam.solver import Options, System, optimise

SETTLED = Options(max_iterations=30, decrement=0.01, elsewhere=False)
LESS = 0.1  # of cost: what is worth an optimum of all
NONE = np.zeros(0, np.int64)


def turned_with_its_eyes(values: Values, tables: Sequence[Table], base: int) -> Values | None:
    """`values` with those tags at other poses that cost less once what saw them gives way, `base` where it is; None
    where there are no such.

    Law: what it gives costs less than `values`.
    """
    seen = [table.select(stands(values, table)) for table in tables if table.model == "corners"]
    eyes, counts = np.unique(np.concatenate([NONE, *(table.keys[:, 0] for table in seen)]), return_counts=True)
    held = eyes[counts > 1]
    found = values
    for key in np.unique(np.concatenate([NONE, *(table.keys[:, 1] for table in seen)])):
        sightings = [table.select(table.keys[:, 1] == key) for table in seen]
        firm = [table.select(among(table.keys[:, 0], held)) for table in sightings]
        for pose in [pose for table in sightings if len(table) for pose in others_of(found, table)]:
            one = found.update(Values.of({Kind.POSE3: (np.array([key]), pose)}))
            if sum(map(len, firm)) and _may_stand(one, found, firm, key):
                found = _yielded(one, found, tables, sightings, base)
    return None if found is values else found


def _may_stand(turned: Values, values: Values, firm: Sequence[Table], key: np.int64) -> bool:
    """Whether a tag may stand so by those who saw other tags as well, which hold them."""
    near = np.unique(np.concatenate([table.keys.ravel() for table in firm]))
    cost = cost_of(settled_alone(turned.only(near), firm, key), firm)
    return cost < WORTH * cost_of(values, firm) + MORE


def _yielded(turned: Values, values: Values, tables: Sequence[Table], sightings: Sequence[Table], base: int) -> Values:
    """What is `turned` with what saw it settled, where that costs less; else `values`."""
    eyes = np.unique(np.concatenate([table.keys[:, 0] for table in sightings]))
    around = [table.select(np.atleast_1d(among(table.keys, eyes).reshape(len(table), -1).any(1))) for table in tables]
    around = [table for table in around if len(table)]
    keys: IntArray = np.unique(np.concatenate([table.keys.ravel() for table in around]))
    here = values.only(keys)
    free = np.setdiff1d(np.concatenate([eyes, *(table.keys[:, 1] for table in sightings)]), [base])
    try:
        system = System(here.layout, tables=around, fixed=np.setdiff1d(keys, free))
        settled = optimise(system, turned.only(keys), SETTLED).values
    except SolveError:
        return values
    less = cost_of(here, around) - cost_of(settled, around)
    return values.update(settled.only(free)) if less > LESS else values
