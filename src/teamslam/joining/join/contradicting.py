"""Raw rows with which a join has no optimum, set aside, so that the rest has one.

A squared loss lets a wrong row pull the harder the farther it is off, and what it pulls ends on top of a sensor, where
next to nothing is left that holds it. Under a loss that forgives there is an optimum all the same; the rows that are
far off there (beyond GATE of what noise does) contradict the rest of the map. Without them the search goes on from
there, with the losses that were asked for. They travel on as raw rows of the map, and may be used by a later join.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import BoolArray, Pose
from teamslam.joining.join.interiors import Member
from teamslam.joining.join.optimum import Optimum
from teamslam.model import Loss, Submap, Table, chi2_quantile
from teamslam.solver import Options, Step

FORGIVING = Loss("geman_mcclure", 3.0)
GATE = 0.9999  # of right rows are nearer


def without_contradictions(
    members: Sequence[Member],
    frames: Sequence[Pose],
    options: Options,
    progress: Callable[[Step], None] | None,
) -> Optimum | None:
    """The optimum without raw rows that contradict the rest of a map, which has none with them; None where that is not
    found either, or where no row is far off."""
    try:
        found = Optimum.of([Member(_forgiving(member.joined)) for member in members], frames, options, progress)
        raw = [table for member in members for table in member.joined.raw]
        usable = [table.select(np.asarray(_held(table, found))) for table in raw]
        right = [_near(table, found) for table in usable]
        kept, aside = ([t.select(m) for t, m in zip(usable, masks, strict=True) if m.any()]
                       for masks in (right, [~mask for mask in right]))  # fmt: skip
        if not aside:
            return None
        rest = Optimum.near(members, found.shared.values, kept, found.fixed, options)
    except SolveError:
        return None
    return replace(rest, aside=tuple(aside))


def _forgiving(submap: Submap) -> Submap:
    return replace(submap, raw=tuple(table.with_loss(FORGIVING) for table in submap.raw))


def _held(table: Table, found: Optimum) -> BoolArray:
    """Which rows (m,) of a table the map of `found` was made of."""
    used = [t.ids for t in found.used if (t.robot, t.kind) == (table.robot, table.kind)]
    return np.isin(table.ids, np.concatenate([np.zeros(0, np.int64), *used]))


def _near(table: Table, found: Optimum) -> BoolArray:
    """Which rows (m,) are as near to the map of `found` as right ones are."""
    squared = np.sum(table.whitened(found.shared.values) ** 2, -1) if len(table) else np.zeros(0)
    return np.asarray(squared <= chi2_quantile(GATE, table.ranks))
