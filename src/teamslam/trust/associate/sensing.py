"""Sightings of landmarks as association sees them: one robot's, image by image.

Of what a single sighting does not place (a range, a bearing) no identity can be told; such sightings stay as they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining.start.targets import WHOLE
from teamslam.model import SQUARED, Dataset, Table, Values, is_landmark, is_unnamed
from teamslam.solver import linearise_numerically

RARE = 1.0  # of sightings of known landmarks for one of a new one
PLACED = (*WHOLE, "relative_pose")  # models of which one sighting places its target


@dataclass(frozen=True, eq=False)
class Seen:
    """All sightings of landmarks by one robot that place their target: `tables`, of which row n of all together was
    taken from pose `observers[n]`, of a landmark called `labels[n]`, -1 where nobody said; `origin` (m, 2) is its
    place: which table of the log, which row."""

    tables: tuple[Table, ...]
    observers: IntArray
    labels: IntArray
    origin: IntArray

    def __len__(self) -> int:
        return len(self.observers)

    @classmethod
    def of(cls, log: Dataset, robot: int) -> "Seen":
        """A robot's sightings in a log."""
        tables, origin = [], []
        for place, table in enumerate(log.tables):
            if table.robot != robot or table.model not in PLACED:
                continue
            rows = np.flatnonzero(is_landmark(table.keys[:, 1]) & (table.ranks == table.row.residual_rows(table.dim)))
            if len(rows):
                tables.append(replace(table.select(rows), loss=SQUARED))
                origin.append(np.stack([np.full(len(rows), place), rows], -1))
        keys = np.concatenate([t.keys for t in tables] or [np.zeros((0, 2), np.int64)])
        labels = np.where(is_unnamed(keys[:, 1]), -1, keys[:, 1])
        return cls(tuple(tables), keys[:, 0], labels, np.concatenate(origin or [np.zeros((0, 2), np.int64)]))

    @property
    def targets(self) -> IntArray:
        """The key that each sighting's target has in the log (m,)."""
        return np.concatenate([table.keys[:, 1] for table in self.tables] or [np.zeros(0, np.int64)])

    @property
    def cells(self) -> Array:
        """For each sighting -2 log of how likely it is of a landmark that nobody knew (m,): anywhere in what its sensor
        sees, as spread as it has seen, and one in RARE."""
        out = []
        for table in self.tables:
            middle = np.argsort(table.values[:, 0], kind="stable")[len(table) // 2]
            off = table.row.minus(table.values, np.broadcast_to(table.values[middle], table.values.shape), table.dim)
            spread = np.std((table.whitening @ off[..., None])[..., 0], axis=0)
            out.append(np.full(len(table), 2.0 * np.log(RARE * np.prod(np.maximum(np.sqrt(12.0) * spread, 1.0)))))
        return np.concatenate(out)

    def select(self, places: IntArray) -> "Seen":
        """Some of the sightings, in their order."""
        places = np.sort(places)
        parts = np.split(places, np.searchsorted(places, np.cumsum([len(table) for table in self.tables])))
        starts = np.cumsum([0, *map(len, self.tables)])
        some = [t.select(at - first) for t, at, first in zip(self.tables, parts, starts, strict=False) if len(at)]
        return Seen(tuple(some), self.observers[places], self.labels[places], self.origin[places])

    def blurred(self, scale: float) -> "Seen":
        """The same sightings, with errors so many times larger."""
        return replace(self, tables=tuple(replace(t, whitening=t.whitening / scale) for t in self.tables))

    def rows(self, places: IntArray, targets: IntArray) -> list[tuple[IntArray, Table]]:
        """Sightings as if of `targets` (k,): for each table, which of `places` (k,) are its rows, and these."""
        starts = np.cumsum([0, *map(len, self.tables)])
        out = []
        for number, table in enumerate(self.tables):
            at = np.flatnonzero((places >= starts[number]) & (places < starts[number + 1]))
            if len(at):
                part = table.select(places[at] - starts[number])
                out.append((at, replace(part, keys=np.stack([part.keys[:, 0], targets[at]], -1))))
        return out


@dataclass(frozen=True, eq=False)
class Slopes:
    """Residuals e (k, r) in sigmas and Jacobians (k, r, of the pose) and (k, r, of the target); rows of zeros are no
    numbers."""

    error: Array
    of_pose: Array
    of_target: Array
    rank: IntArray


def slopes(rows: Sequence[tuple[IntArray, Table]], values: Values, count: int) -> Slopes:
    """The sightings of `Seen.rows` at `values`, in their order; all targets of one kind."""
    parts = []
    for at, table in rows:
        for group in linearise_numerically(table, values):
            split = int(values.layout.dofs[group.index[0, 0]])
            parts.append((at[group.rows], group.error, group.jacobian[..., :split], group.jacobian[..., split:]))
    deep = max(error.shape[1] for _, error, _, _ in parts)
    error = np.zeros((count, deep))
    of_pose = np.zeros((count, deep, parts[0][2].shape[2]))
    of_target = np.zeros((count, deep, parts[0][3].shape[2]))
    rank = np.zeros(count, np.int64)
    for at, e, x, y in parts:
        error[at, : e.shape[1]], of_pose[at, : e.shape[1]], of_target[at, : e.shape[1]] = e, x, y
        rank[at] = e.shape[1]
    return Slopes(error, of_pose, of_target, rank)
