"""A robot's own submaps linearised where the map has them, for the pose of now.

A submap is linearised once, where its piece alone has its least; a map that lies far from there is read off a Gaussian
that is no longer the measurements'. What is sent stays what it is, but the robot holds the rows, and can do beside its
steps what exact rounds do between robots: linearise them where the map is, and eliminate what only this piece knows.

    moved     whether the map has moved a submap since, by more than FAR of its sigmas
    again     the submap on what it shares, linearised where the map has it
"""

from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray
from teamslam.joining.exact.robot import Part, Sending
from teamslam.model import Dataset, Submap, Values

FAR = 0.1  # [sigma] of the combination of variables that moved farthest


@dataclass(frozen=True, eq=False)
class Linearised:
    """A submap condensed to the variables `keep`: `submap`, from rows linearised at `point`, the estimate of all that
    the `whole` one knows, in its frame. `own`: whether it is the robot's own; `piece`: then its rows, where they are at
    hand."""

    keep: IntArray
    submap: Submap
    whole: Submap
    point: Values
    own: bool
    piece: Dataset | None = None

    def anew(self, known: Values) -> "Linearised":
        """Linearised where a map has it, if the map moved it. Law: where the map stands still, that is the least
        squares of the rows, but for how rotations bend from there to the submap's own least."""
        return self._again(self.piece, known) if self.piece is not None and self._moved(known) else self

    def _moved(self, known: Values) -> bool:
        layout = self.submap.values.layout
        if not (known.layout.contains(layout.keys).all() and known.layout.contains(self.submap.base)):
            return False
        shift = known.seen_from(known.pose(self.submap.base), layout).minus(self.point.only(layout.keys))
        return float(shift @ (self.submap.information @ shift)) > FAR**2

    def _again(self, piece: Dataset, known: Values) -> "Linearised":
        """As it is where the rows leave something open there."""
        layout = self.whole.values.layout
        kept = np.isin(layout.keys, self.submap.values.layout.keys)
        try:
            part = Part.of(piece, self.whole, Sending(kept, layout.select(kept), False, 0))
            part.values = self.point
            part.reduce()
            part.values = part.moved(known, 1.0)
            found = part.reduce()
            step = np.linalg.solve(found.information.toarray(), found.slope)
        except (SolveError, np.linalg.LinAlgError):
            return self
        if not np.isfinite(step).all():
            return self
        there = replace(self.submap, values=part.separators.retract(step), information=found.information)
        return replace(self, submap=there, point=part.values)
