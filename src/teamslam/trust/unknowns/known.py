"""Unknowns as variables of a map: what is left uncertain of them is in its covariances (see `calibration.carried`).

With H the information of a map were they known, C = J'WD what its rows say of both, and P the covariance of the
unknowns beside the map, the whole is

    [ H    -C              ]          whose inverse has P for the unknowns, and
    [-C'   P^-1 + C'H^-1 C ]          H^-1 + H^-1 C P C' H^-1 for the map

At full least squares that is the information of both together. A join's H is its own, and stays so. The estimates do
not move: the unknowns are at their optimum.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining import AtMap
from teamslam.model import Submap, Table
from teamslam.solver import Factor
from teamslam.trust.calibration.carried import bordered
from teamslam.trust.calibration.rows import linearised
from teamslam.trust.unknowns.effects import Effects, Sensor


@dataclass(frozen=True, eq=False)
class Known:
    """What unknowns do to rows by their ids (rising), in units of their sigmas: de/dp (m, rows, k) by sensor; and their
    covariance (k, k) in the same units."""

    effects: dict[Sensor, tuple[IntArray, Array]]
    covariance: Array

    def on(self, table: Table) -> Array | None:
        """The effects on the rows of a table (m, rows, k), zero where none are known; None where there are none."""
        found = self.effects.get((table.robot, table.kind))
        if found is None:
            return None
        ids, effect = found
        at = np.minimum(np.searchsorted(ids, table.ids), len(ids) - 1)
        return np.where((ids[at] == table.ids)[:, None, None], effect[at], 0.0)


def known_at(maps: Sequence[AtMap], effects: Effects, covariance: Array) -> Known:
    """What is known of unknowns with a covariance (k, k), and what they do to the rows at the maps."""
    sigmas = np.sqrt(np.diag(covariance))
    free = np.flatnonzero(sigmas > 0.0)
    rows: dict[Sensor, list[tuple[IntArray, Array]]] = {}
    for at in maps:
        for table in at.tables:
            if (effect := effects.at(at, table)[..., free] * sigmas[free]).any():
                rows.setdefault((table.robot, table.kind), []).append((table.ids, effect))
    sorted_rows = {}
    for sensor, parts in rows.items():
        ids, effect = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(ids)
        sorted_rows[sensor] = ids[order], effect[order]
    own = sigmas[free]
    return Known(sorted_rows, covariance[np.ix_(free, free)] / np.outer(own, own))


def with_unknowns(map: Submap, tables: Iterable[Table], known: Known) -> Submap:
    """A map with the unknowns among its variables; itself where none of its rows depends on them."""
    rows = [(table, known.on(table)) for table in AtMap(list(tables), map).tables]
    touched = [(table, effect) for table, effect in rows if effect is not None and effect.any()]
    if not touched:
        return map
    values = map.all_values if map.base >= 0 else map.values
    held = values.layout.keys[~map.values.layout.contains(values.layout.keys)]
    cross = np.zeros((map.dof, len(known.covariance)))
    linear = linearised([table for table, _ in touched], values, held, map.names)
    for (table, effect), (error, jacobian) in zip(touched, linear, strict=True):
        weight = table.loss.weight(np.sum(table.whitened(values) ** 2, -1))
        information = weight[:, None, None] * np.swapaxes(table.whitening, 1, 2) @ table.whitening
        cross -= jacobian.T @ (information @ effect).reshape(error.size, -1)
    shows = np.abs(cross).any(0)
    cross, covariance = cross[:, shows], known.covariance[np.ix_(shows, shows)]
    factor = Factor.of(map.values.layout, map.information, map.names, map.values)
    own = np.linalg.inv(covariance) + cross.T @ factor.solve(cross)
    nothing = np.zeros(len(own))
    return bordered(map, factor, cross, 0.5 * (own + own.T), nothing, nothing)
