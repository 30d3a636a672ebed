"""What unknowns do to the rows of a log, by differences: D = de/dp, at the map.

e_i(x (+) d, p + q)  ~  e_i - J_i d + D_i q          in the units of the measurement, not whitened

What a moment does to corners depends on where they are, and how far away. Both are asked of the map, of which e is
independent. By the corners that were seen, their noise would be in D as in e: E[D' W e] = v / r of each number, all of
one sign where a robot drives ahead at v, and its cameras would be told to stamp too early.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.joining import AtMap
from teamslam.model import Standing, Table, Unknowns

Sensor = tuple[int, tuple[str, str, int]]


class Effects:
    """How the sightings of a log change with its unknowns: made once by all of its maps, asked at each of them."""

    def __init__(self, unknowns: Unknowns, maps: Sequence[AtMap]) -> None:
        each, values = unknowns.each, unknowns.values
        self.steps, standing = np.array([unknown.step for unknown in each]), _standing_in(maps)
        self._both = [
            tuple(_by_sensor(unknowns.varied(there, standing)) for there in (values + step, values - step))
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


def _standing_in(maps: Sequence[AtMap]) -> Standing:
    """How what eyes saw stands to them in maps."""
    parts: dict[tuple[int, str], list[tuple[IntArray, Pose]]] = {}
    for at in maps:
        for table in at.tables:
            if table.model == "corners":
                observer, target = table.ends(at.values)
                assert observer is not None and isinstance(target, Pose) and table.sensor is not None
                seen = (observer.lift(3) @ table.sensor).between(target.lift(3))
                parts.setdefault((table.robot, table.source), []).append((table.ids, seen))
    found = {}
    for of, rows in parts.items():
        ids, poses = np.concatenate([i for i, _ in rows]), concatenate([p for _, p in rows])
        order = np.argsort(ids)
        found[of] = ids[order], poses[order]
    return found


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
