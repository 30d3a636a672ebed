"""Parts of a map that hang on one tag which has the wrong pose: four corners fit two poses, and what hangs on the tag
swung round with it.

    part:    without the sightings of one tag the rest falls into parts; each sees the tag for itself
    swung:   one part sees the tag at the other pose that its sightings agree on (see `mirrored`), and all others go
             with the tag, as they are: only the rows between the part and the others change
    offered: those ways in which these rows cost little more, cheapest first; which of them is lower at its optimum,
             the least squares say

Held by nothing else, all others fit as well wherever the part is, so no tag that is turned alone shows it. What
odometry ties as well costs far more when it swings, and is not offered. It takes a search of the graph for each tag. In
space only: robots of a plane are held upright by it.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from teamslam.frontend.tags.mirrored import TURNED, cost_of, others_of, settled_alone, stands
from teamslam.geometry import BoolArray, IntArray
from teamslam.model import Kind, Table, Values, among
from teamslam.model.sparse import sp

NONE = np.zeros(0, np.int64)
TRIED = 8  # ways that are offered at most
MORE = 100.0  # of cost: what a way may cost, before anything gives way, that is worth an optimum


def swung(values: Values, tables: Sequence[Table], base: int) -> list[Values]:
    """`values` with one part or another swung about the tag that it hangs on, `base` where it is; cheapest first.

    Law: but for rows between the part and the others, all rows cost what they cost before.
    """
    found = [(_more(values, other, moved, tables), other) for other, moved in _ways(values, tables, base)]
    return [other for more, other in sorted(found, key=lambda way: way[0])[:TRIED] if more < MORE]


def _ways(values: Values, tables: Sequence[Table], base: int) -> Iterator[tuple[Values, BoolArray]]:
    """All of them, and which variables are moved."""
    keys, poses = np.sort(values.layout.keys), values.layout.keys_of(Kind.POSE3)
    seen = [table.select(stands(values, table)) for table in tables if table.model == "corners"]
    seen = [table.select(among(table.keys[:, 0], poses)) for table in seen]
    seen = [table for table in seen if len(table)]
    ends = [np.searchsorted(keys, table.keys) for table in seen]
    for tag in np.unique(np.concatenate([NONE, *(both[:, 1] for both in ends)])).tolist():
        parts = _parts(ends, tag, len(keys))
        here = [parts[both[both[:, 1] == tag, 0]] for both in ends]
        seeing = np.unique(np.concatenate(here))
        if len(seeing) < 2:
            continue
        sizes = np.bincount(parts)
        for part in seeing[sizes[seeing] > 1].tolist():
            mine = [(both[:, 1] == tag) & (parts[both[:, 0]] == part) for both in ends]
            rows = [table.select(own) for table, own in zip(seen, mine, strict=True)]
            moved = parts != part
            stay = moved[np.searchsorted(keys, base)]
            which = keys[moved != stay]
            if not among(which, poses).all():
                continue
            for other in _turned(values, [t for t in rows if len(t)], keys[tag]):
                by = other.poses_of(keys[[tag]], 3) @ values.poses_of(keys[[tag]], 3).inverse()
                by = by.inverse() if stay else by
                yield values.update(Values.of({Kind.POSE3: (which, by @ values.poses_of(which, 3))})), moved


def _turned(values: Values, rows: Sequence[Table], tag: np.int64) -> list[Values]:
    """The tag at its other optima by some of its sightings, with these sightings' poses."""
    near, key = values.only(np.unique(np.concatenate([table.keys.ravel() for table in rows]))), np.array([tag])
    found, known = list[Values](), [values.poses_of(key, 3)]
    for pose in (other for table in rows for other in others_of(values, table)):
        other = settled_alone(near.update(Values.of({Kind.POSE3: (key, pose)})), rows, tag)
        here = other.poses_of(key, 3)
        if all(np.linalg.norm(here.minus(pose)[..., 3:]) > TURNED for pose in known):
            known.append(here)
            found.append(other)
    return found


def _parts(ends: Sequence[IntArray], tag: int, n: int) -> IntArray:
    """Which part each of n variables is in without the sightings of one tag, by places in the layout."""
    from scipy.sparse.csgraph import connected_components

    pairs = np.concatenate([both[both[:, 1] != tag] for both in ends])
    graph = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _more(values: Values, other: Values, moved: BoolArray, tables: Sequence[Table]) -> float:
    """What rows between what is moved and what is not cost more."""
    between, keys = [], np.sort(values.layout.keys)
    for table in tables:
        if not table.row.unary:
            ends = moved[np.searchsorted(keys, table.keys)]
            between.append(table.select(ends[:, 0] != ends[:, 1]))
    return cost_of(other, between) - cost_of(values, between)
