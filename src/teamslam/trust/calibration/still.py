"""What is still to be gained at a map of rows that were put right, where how they differ counts as well."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from teamslam.joining import AtMap
from teamslam.joining.exact.gap import Gap, frame_of
from teamslam.model import Submap, Table
from teamslam.model.sparse import sp
from teamslam.solver import Factor
from teamslam.trust.calibration.changed import Change, beyond


class PutRight(AtMap):
    """Rows that were put right, at a map of them, with what those that follow each other say of how they differ."""

    def __init__(self, tables: Iterable[Table], joined: Submap, changes: Sequence[Change]) -> None:
        super().__init__(list(tables), joined)
        self._changes = changes

    @cached_property
    def gap(self) -> Gap:
        """The gap there. Raises SolveError where these rows do not determine the map."""
        gap = super().gap
        told = beyond(self.tables, self._changes, self.values, frame_of(self.joined), self.joined.names)
        if told is None:
            return gap
        more, slope, cost = told
        own = gap.hessian.to_csr()
        information, slope = sp.csr_array(own + more), own @ gap.step + slope
        factor = Factor.of(gap.free, information, self.joined.names, self.values)
        step = factor.solve(slope)
        decrease = max(float(np.dot(slope, step)), 0.0)
        return replace(gap, cost=gap.cost + cost, step=step, decrease=decrease, factor=factor)
