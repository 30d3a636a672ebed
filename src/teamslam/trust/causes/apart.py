"""A landmark in two places as two landmarks, each with a key and a name of its own that nobody else can mean."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.model import Dataset, Table, index_of, landmark_key, landmark_number

Sensor = tuple[int, tuple[str, str, int]]


@dataclass(frozen=True, eq=False)
class Apart:
    """The rows `there` (rising ids, by robot and kind of sensor) of landmark `mark` are of another place than all its
    others; `earlier`: the others were seen first.

    Called with a log it gives it with two landmarks in place of one, "4 at place 1" and "4 at place 2", as they were
    seen first. Law: rows, their numbers and their weights stay as they are, in their order; a log that does not see the
    landmark comes back as it is.
    """

    mark: int
    there: dict[Sensor, IntArray]
    earlier: bool

    @classmethod
    def of(cls, mark: int, tables: Sequence[Table], second: Sequence[BoolArray], *, earlier: bool) -> "Apart":
        """Of the rows of tables that are in its second place (m,)."""
        rows: dict[Sensor, list[IntArray]] = {}
        for table, mask in zip(tables, second, strict=True):
            rows.setdefault((table.robot, table.kind), []).append(table.ids[mask])
        return cls(mark, {sensor: np.sort(np.concatenate(ids)) for sensor, ids in rows.items()}, earlier)

    def __call__(self, log: Dataset) -> Dataset:
        """The log with the landmark in both its places."""
        if not any((table.keys[:, -1] == self.mark).any() for table in log.tables):
            return log
        own = log.names.landmark(int(index_of(self.mark)))
        called = [f"{own} at place {number}" for number in ((1, 2) if self.earlier else (2, 1))]
        here, there = (int(landmark_key(landmark_number(name))) for name in called)
        names = {**log.names.landmarks, **{landmark_number(name): name for name in called}}
        tables = tuple(self.renamed(table, here, there) for table in log.tables)
        return replace(log, tables=tables, names=replace(log.names, landmarks=names))

    def renamed(self, table: Table, here: int, there: int) -> Table:
        """A table with the landmark called by its two names."""
        own = table.keys[:, -1] == self.mark
        if not own.any():
            return table
        moved = np.isin(table.ids, self.there.get((table.robot, table.kind), np.zeros(0, np.int64)))
        keys = table.keys.copy()
        keys[own, -1] = np.where(moved[own], there, here)
        return replace(table, keys=keys)
