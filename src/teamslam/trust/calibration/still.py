"""What is still to be gained at a map of rows that were put right, where how they differ counts as well."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from teamslam.joining import AtMap
from teamslam.joining.exact.gap import Gap
from teamslam.model import Submap, Table
from teamslam.solver import Factor
from teamslam.trust.calibration.changed import Change, differing
from teamslam.trust.calibration.rows import held_at, linearised


class PutRight(AtMap):
    """Rows that were put right, at a map of them, with what those that follow each other say of how they differ."""

    def __init__(self, tables: Iterable[Table], joined: Submap, changes: Sequence[Change]) -> None:
        super().__init__(list(tables), joined)
        self._changes = changes

    @cached_property
    def gap(self) -> Gap:
        """The gap there. Raises SolveError where these rows do not determine the map."""
        gap = super().gap
        self.__dict__["gap"] = gap  # for what is held there
        told = [(table, differ) for table in self.tables if (differ := differing(table, self._changes)) is not None]
        if not told:
            return gap
        information = gap.hessian.to_csr()
        slope, cost = information @ gap.step, gap.cost
        linear = linearised([table for table, _ in told], self.values, held_at(self), self.joined.names)
        for (_, differ), (error, jacobian) in zip(told, linear, strict=True):
            along, left = differ @ jacobian, differ @ error.ravel()
            information, slope, cost = information + along.T @ along, slope + along.T @ left, cost + float(left @ left)
        factor = Factor.of(gap.free, sp.csr_array(information), self.joined.names, self.values)
        step = factor.solve(slope)
        decrease = max(float(np.dot(slope, step)), 0.0)
        return replace(gap, cost=cost, step=step, decrease=decrease, factor=factor)
