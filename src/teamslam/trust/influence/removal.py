"""Submaps taken out of a map, as if they had never been in it.

The downdate says where the rest goes to second order; a solve from there ends where joining the rest ends, in a step or
two. Where what is taken out held the rest together, or the rest is but one submap, the rest is joined anew.
"""

from collections.abc import Collection, Sequence

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining import Component, Joined, join
from teamslam.joining.join.gauge import anchor
from teamslam.joining.join.interiors import members_of
from teamslam.joining.join.join import in_order
from teamslam.joining.join.optimum import Optimum, usable_rows
from teamslam.model import WORLD, Kind, Submap, Values
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS
from teamslam.trust.influence.parts import tied


def without(
    submaps: Sequence[Submap],
    joined: Joined,
    gone: Collection[str],
    *,
    near: Values | None = None,
    options: Options = DEFAULTS,
) -> Joined:
    """The map of the submaps but those whose ids are `gone`; `near`: where it is expected, as a downdate says.

    Law: to rounding, what joining the rest gives, if that finds the same optimum.
    """
    rest = [submap for submap in submaps if submap.id not in gone]
    if near is None or len(joined.components) > 1 or joined.map.base == WORLD or len(rest) < 2 or not tied(rest):
        return join(rest, options=options)
    members = members_of(in_order(rest))
    first = members[0].whole
    if not near.layout.contains(first.base):
        return join(rest, options=options)
    held = np.unique(np.concatenate([m.joined.keys for m in members]))
    start = near.select(np.isin(near.layout.keys, held))
    if any(Kind(kind).dim < first.base_dim for kind in np.unique(start.layout.kinds)):
        return join(rest, options=options)  # what stands in the plane is not seen from a base in space
    start = start.transform(start.poses_of(np.array(first.base), first.base_dim).inverse())
    used, _ = usable_rows([t for m in members for t in m.joined.raw], start.layout)
    start, fixed, used = anchor(start, first, used)
    try:
        found = Optimum.near(members, start, used, fixed, options)
    except SolveError:
        return join(rest, options=options)
    ids = tuple(sorted(submap.id for submap in rest))
    return Joined((Component(found.map(first.base_dim), found.solution, ids),))
