"""A systematic error that was estimated, and what it does to each row."""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Table


@dataclass(frozen=True, eq=False)
class Systematic:
    """`value` of a `term` (see `terms`) of a robot's sensor, in its `unit`, with the deviation `sigma` that is left of
    it and the `prior` one; `effect` (m, rows) of one unit on the rows `ids` (m,), rising. `landmark`: the key
    of that which it is of, 0 where it is of all."""

    robot: int
    source: str
    model: str
    dim: int
    term: str
    unit: str
    value: float
    sigma: float
    prior: float
    ids: IntArray
    effect: Array
    landmark: int = 0

    def on(self, table: Table) -> Array | None:
        """Its effect on the rows of a table (m, rows), zero where none is known; None where it is about others."""
        if (self.robot, self.source, self.model, self.dim) != (table.robot, *table.kind) or not len(self.ids):
            return None
        at = np.minimum(np.searchsorted(self.ids, table.ids), len(self.ids) - 1)
        return np.where((self.ids[at] == table.ids)[:, None], self.effect[at], 0.0)
