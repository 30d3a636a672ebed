"""A stretch of log solved anew, as it is and as it would be without a mistake: what each costs.

With a mistake in the log the map itself is bent, so residuals at that map do not tell which mistake it was. A stretch
of a few dozen poses is mapped in some hundredths of a second, though, and from its own odometry: every mistake gets a
fair trial. All rows are under Huber's loss, so that outliers do not decide.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array
from teamslam.joining import Joined, build, cost_of, join, split
from teamslam.joining.exact.gap import point_of
from teamslam.model import Dataset, Loss, Values, chi2_quantile, robot_of
from teamslam.solver import Options
from teamslam.trust.expected import expected_cost

ROBUST = Loss("huber", 3.0)
QUICK = Options(max_iterations=60, decrement=0.05)
FAILED = float("inf")
MOST_PIECES = 3  # of each robot
FEWEST = 5  # rows of a sensor that is judged by itself
TWICE = 2.0
LOST = 9.0  # of each number that has no place in the map


@dataclass(frozen=True, eq=False)
class Trial:
    """A stretch of a team's log. `cost` is that of its optimum (infinite where none is found), `expected` what it
    should be if the model is right."""

    log: Dataset

    @classmethod
    def of(cls, log: Dataset) -> "Trial":
        """The stretch as it is written, under a loss that forgives outliers."""
        return cls(log.with_tables(table.with_loss(ROBUST) for table in log.tables))

    @cached_property
    def joined(self) -> Joined | None:
        """The stretch solved; None where that fails."""
        try:
            pieces = split(self.log)
            if len(pieces) > MOST_PIECES * len(self.log.robots):
                return None  # its odometry is in shreds: that is no log
            return join([build(piece, options=QUICK) for piece in pieces], options=QUICK)
        except TeamslamError:
            return None

    @cached_property
    def values(self) -> Values | None:
        """Where all is, if the stretch makes one map."""
        one = self.joined is not None and len(self.joined.components) == 1
        return point_of(self.joined.map) if one and self.joined is not None else None

    @cached_property
    def cost(self) -> float:
        """What the stretch costs once it is solved: at the map that `join` makes of it. What has no place in the map
        counts as gross misfits."""
        if self.joined is None:
            return FAILED
        found = [cost_of(component.map, self.log.tables) for component in self.joined.components]
        lost = self.log.dof - sum(part.rows for part in found)
        return sum(part.cost for part in found) + LOST * lost

    @cached_property
    def expected(self) -> float:
        """As it would be on average, with what its unknowns take away."""
        cost = taken = 0.0
        for table in self.log.tables:
            row = expected_cost(table.loss, table.row.residual_rows(table.dim))
            cost += len(table) * row.mean
            taken += table.dof * row.given_way
        return max(cost - taken * self.log.layout.dof / max(self.log.dof, 1), 1.0)

    @cached_property
    def ratio(self) -> float:
        """Cost over expected cost, in all or of the worst sensor: of one sensor by the median of its squared residuals,
        which few outliers do not move, over twice what that should be."""
        if self.joined is None:
            return FAILED
        medians = [float(np.median(s)) for s in self._by_sensor().values() if len(s) >= FEWEST]
        return max([self.cost / self.expected, *(m / TWICE for m in medians)])

    def _by_sensor(self) -> dict[tuple[int, str, int], Array]:
        """The squared residuals of each robot's rows of each source, of each robot that they see by itself, over what
        their median should be."""
        found: dict[tuple[int, str, int], list[Array]] = {}
        for component in self.joined.components if self.joined else ():
            values = point_of(component.map)
            for table in self.log.tables:
                here = table.select(table.told_by(values.layout))
                seen = np.maximum(robot_of(here.keys[:, -1]), 0)
                for who in np.unique(seen).tolist():
                    rows = here.select(seen == who)
                    usual = chi2_quantile(0.5, np.maximum(rows.ranks, 1))
                    size = np.sum(rows.whitened(values) ** 2, -1) / usual
                    found.setdefault((table.robot, table.source, who), []).append(size)
        return {sensor: np.concatenate(sizes) for sensor, sizes in found.items()}
