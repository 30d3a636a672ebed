"""A log without steps of a robot's odometry: it is cut there, and what is seen before and after ties both parts."""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import BoolArray, IntArray
from teamslam.model import Dataset, LeftOut, Sources, Table


@dataclass(frozen=True, eq=False)
class Cut:
    """The rows `steps` (ids) of robot `robot`'s log of a `source` that contradict all else, the poses `between` them,
    of which nobody knows to which side they belong, `what` that is in words, and the `reason` why it is left out.

    Called with a log it gives it without them. Law: all other rows stay as they are, in their order.
    """

    robot: int
    source: str
    steps: IntArray
    between: IntArray
    what: str
    reason: str

    def __call__(self, log: Dataset) -> Dataset:
        """The log without these steps, and without whatever speaks of the poses between."""
        kept = [table.select(~self._of(table)) for table in log.tables]
        return log.with_tables(table for table in kept if len(table))

    def lost(self, log: Dataset) -> LeftOut:
        """What a log loses by it: these rows, and the poses and landmarks of which no other speaks."""
        rows = [table.select(mask) for table in log.tables if (mask := self._of(table)).any()]
        keys = np.setdiff1d(log.layout.keys, self(log).layout.keys)
        return LeftOut("rows", self.what, keys, Sources.of(rows), sum(map(len, rows)), self.reason)

    def _of(self, table: Table) -> BoolArray:
        about = np.isin(table.keys, self.between).any(1)
        mine = (table.robot, table.source) == (self.robot, self.source) and table.model == "relative_pose"
        return np.asarray(about | np.isin(table.ids, self.steps) if mine else about)
