"""Maps that came apart though what they share would hold them together, did it agree: put together all the same.

A join does not put together what fits nowhere. To judge who is wrong, all have to be weighed in one problem: each map
is laid on the first by one rigid fit over all that both know, and the whole is solved from there. What it costs says
how badly they contradict each other.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Pose, align
from teamslam.joining import Component, Joined
from teamslam.joining.exact.gap import point_of
from teamslam.joining.join.interiors import members_of
from teamslam.joining.join.join import in_order
from teamslam.joining.join.optimum import Optimum
from teamslam.model import Submap
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS

HELD = 1e-3  # [m^2] of rigidity: points a few centimetres apart hold nothing
SPARE = 3  # things shared at least beyond which a map that fits nowhere contradicts


def together(submaps: Sequence[Submap], joined: Joined, options: Options = DEFAULTS) -> Joined:
    """A join in which components that share enough to be held, but do not fit, are one; as it was where none are."""
    found = joined
    for other in joined.components[1:]:
        first = found.components[0]
        frame = _laid_on(first.map, other.map)
        merged = None if frame is None else _merged(submaps, first, other, frame, options)
        if merged is not None:
            rest = [
                (c, reason) for c, reason in zip(found.components[1:], found.reasons, strict=True) if c is not other
            ]
            components, reasons = (merged, *(c for c, _ in rest)), tuple(reason for _, reason in rest)
            found = replace(found, components=components, reasons=reasons)
    return found


def _laid_on(one: Submap, other: Submap) -> Pose | None:
    """The frame of another map in one, by all that both know; None where that leaves it open."""
    here, there = point_of(one), point_of(other)
    shared = np.intersect1d(here.layout.keys, there.layout.keys)
    dim = max(one.base_dim, other.base_dim)
    if len(shared) < SPARE or one.base < 0 or other.base < 0 or one.base_dim != other.base_dim:
        return None
    fit = align(there.positions(shared, 3)[:, :dim], here.positions(shared, 3)[:, :dim])
    return fit.pose if fit.rigidity > HELD else None


def _merged(
    submaps: Sequence[Submap], one: Component, other: Component, frame: Pose, options: Options
) -> Component | None:
    ids = tuple(sorted((*one.members, *other.members)))
    members = members_of(in_order(submap for submap in submaps if submap.id in ids))
    known = point_of(one.map).update(point_of(other.map).transform(frame))
    frames = [known.poses_of(np.array(member.whole.base), member.whole.base_dim) for member in members]
    root = frames[0].inverse()
    try:
        found = Optimum.of(members, [root @ frame for frame in frames], options, None)
    except TeamslamError:
        return None
    return Component(found.map(members[0].whole.base_dim), found.solution, ids)
