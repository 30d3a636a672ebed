"""What unknowns do to the rows of a log, by differences: D = de/dp, at the map.

e_i(x (+) d, p + q)  ~  e_i - J_i d + D_i q          in the units of the measurement, not whitened
"""

from collections.abc import Iterable, Sequence

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining import AtMap
from teamslam.model import Table, Unknowns

Sensor = tuple[int, tuple[str, str, int]]


class Effects:
    """How the sightings of a log change with its unknowns: made once, asked at each of its maps."""

    def __init__(self, unknowns: Unknowns) -> None:
        each, values = unknowns.each, unknowns.values
        self.steps = np.array([unknown.step for unknown in each])
        self._both = [
            (_by_sensor(unknowns.varied(values + step)), _by_sensor(unknowns.varied(values - step)))
            for step in np.diag(self.steps)
        ]

    def at(self, at: AtMap, table: Table) -> Array:
        """de/dp (m, rows, k) of the rows of a table at a map; zeros for rows that do not depend on any."""
        out = np.zeros((len(table), table.row.residual_rows(table.dim), len(self.steps)))
        for k, (plus, minus) in enumerate(self._both):
            for one, other in zip(plus.get(_sensor(table), ()), minus.get(_sensor(table), ()), strict=True):
                ids = np.intersect1d(np.intersect1d(one.ids, other.ids), table.ids)
                if len(ids):
                    up, down = (_rows(t, ids).residual(at.values) for t in (one, other))
                    out[_places(table, ids), :, k] = (up - down) / (2.0 * self.steps[k])
        return out


def _sensor(table: Table) -> Sensor:
    return table.robot, table.kind


def _by_sensor(tables: Iterable[Table]) -> dict[Sensor, Sequence[Table]]:
    out: dict[Sensor, list[Table]] = {}
    for table in tables:
        out.setdefault(_sensor(table), []).append(table)
    return dict(out)


def _rows(table: Table, ids: IntArray) -> Table:
    return table.select(_places(table, ids))


def _places(table: Table, ids: IntArray) -> IntArray:
    """Where each of `ids`, which all are there, is among the rows."""
    order = np.argsort(table.ids, kind="stable")
    return np.asarray(order[np.searchsorted(table.ids, ids, sorter=order)])
