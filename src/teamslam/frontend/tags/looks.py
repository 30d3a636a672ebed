"""Sightings of landmarks as poses, by a robot along its way, and what each of them may stand for."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.frontend.tags.corner_errors import CornerErrors
from teamslam.frontend.tags.whole_poses import hypotheses, tells_pose
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.model import Table, Values, is_landmark

WIDEST = 8  # rows of a residual: those of corners


@dataclass(frozen=True, eq=False)
class Looks:
    """Sightings (m,) of landmarks as poses: from which pose, of which landmark, by which row of which table, with what
    each may stand for (m, 2)."""

    tables: Sequence[Table]
    marks: IntArray
    frame: IntArray
    mark: IntArray
    table: IntArray
    row: IntArray
    poses: Pose
    costs: Array
    numbers: IntArray

    @classmethod
    def of(cls, tables: Sequence[Table], way: Values) -> "Looks":
        keys = way.layout.keys
        seen = [t for t in tables if tells_pose(t)]
        seen = [t.select(is_landmark(t.keys[:, 1]) & way.layout.contains(t.keys[:, 0])) for t in seen]
        seen = [t for t in seen if len(t)]
        none = np.zeros(0, np.int64)
        marks = np.unique(np.concatenate([none, *(t.keys[:, 1] for t in seen)]))
        told = [hypotheses(t) for t in seen]
        return cls(
            seen,
            marks,
            np.concatenate([none, *(np.searchsorted(keys, t.keys[:, 0]) for t in seen)]),
            np.concatenate([none, *(np.searchsorted(marks, t.keys[:, 1]) for t in seen)]),
            np.concatenate([none, *(np.full(len(t), k) for k, t in enumerate(seen))]),
            np.concatenate([none, *(np.arange(len(t)) for t in seen)]),
            concatenate([poses for poses, _ in told]) if told else Pose.identity(3, (0, 2)),
            np.concatenate([np.zeros((0, 2)), *(costs for _, costs in told)]),
            np.concatenate([none, *(t.ranks for t in seen)]),
        )

    @cached_property
    def _corners(self) -> tuple[CornerErrors, IntArray]:
        """The sightings of corners, and which of them each sighting (m,) is; -1 of others."""
        which = [k for k, table in enumerate(self.tables) if table.model == "corners"]
        place = np.full(len(self.table), -1)
        own = np.isin(self.table, which)
        place[own] = np.arange(np.count_nonzero(own))
        return CornerErrors.of([self.tables[k] for k in which]), place

    def errors(self, rows: IntArray, observers: Pose, targets: Pose) -> Array:
        """Whitened residuals (c, k, WIDEST) of some sightings (k,) at poses of both ends, (c, k), (1, k) or (c, 1)
        each; zeros beyond a model's own."""
        corners, place = self._corners
        own = place[rows]
        if (own >= 0).all():
            return corners.at(own, observers, targets)
        shape = np.broadcast_shapes(observers.batch, targets.batch, (1, len(rows)))
        ends = [Pose(np.broadcast_to(X.rotation, (*shape, 3, 3)), np.broadcast_to(X.translation, (*shape, 3)))
                for X in (observers, targets)]  # fmt: skip
        out = np.zeros((*shape, WIDEST))
        for number in np.unique(self.table[rows]).tolist():
            at = np.flatnonzero(self.table[rows] == number)
            part = self.tables[number].select(self.row[rows[at]])
            for c in range(shape[0]):
                error = part.row.minus(part.values, part.predict_from(*(X[c][at] for X in ends)), part.dim)
                out[c, at, : error.shape[1]] = (part.whitening @ error[..., None])[..., 0]
        return out

    def cost(self, rows: IntArray, squared: Array) -> float:
        """What some sightings cost by the losses of their tables, of squared whitened residuals (k,)."""
        of = self.table[rows]
        return sum(float(self.tables[n].loss.cost(squared[of == n]).sum()) for n in np.unique(of).tolist())

    def only(self, rows: IntArray) -> list[Table]:
        """Some sightings, as tables."""
        of = self.table[rows]
        return [self.tables[n].select(np.sort(self.row[rows[of == n]])) for n in np.unique(of).tolist()]

    def candidates(self, rows: IntArray) -> tuple[IntArray, Pose]:
        """What some sightings may stand for: the sighting (as a place in `rows`) and the pose of each."""
        which, hypothesis = np.nonzero(np.isfinite(self.costs[rows]))
        return which, Pose(
            self.poses.rotation[rows[which], hypothesis], self.poses.translation[rows[which], hypothesis]
        )
