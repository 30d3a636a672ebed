"""A stretch of log solved anew, as it is and as it would be without a mistake: what each costs, how likely each is.

With a mistake in the log the map itself is bent, so residuals at that map do not tell which mistake it was. A stretch
of a few dozen poses is mapped in some hundredths of a second, though, and from its own odometry: every mistake gets a
fair trial. All rows are under Huber's loss, so that outliers do not decide.

How likely the measurements z are, whatever the map x is, is an integral over x (Laplace's method; H at the optimum):

    -2 log p(z)  =  F(x^)  +  log det H  +  2 l log L  -  2 sum log det W  -  2 n log f  +  const

where each of l unknown lengths may be anything within the map's own extent L, and n numbers were written in another
unit f. Without log det H, sigmas taken for smaller ones would win wherever little is measured twice; without L, large
maps, which have room for more.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, IntArray
from teamslam.joining import AtMap, Joined, build, join, split
from teamslam.joining.exact.gap import frame_of
from teamslam.model import Dataset, Loss, Table, Values, robot_of
from teamslam.solver import Options, System, optimise
from teamslam.trust.expected import expected_cost
from teamslam.trust.residuals import beside_median

ROBUST = Loss("huber", 3.0)
QUICK = Options(max_iterations=25, decrement=0.05, elsewhere=False)  # what makes no sense is an answer
FAILED = float("inf")
MOST_PIECES = 3  # of each robot
FEWEST = 5  # rows of a sensor that is judged by itself
TWICE = 2.0
TINY = 1e-12
LOST = 9.0  # of each number that has no place in the map, and at most of each in `bulk`


@dataclass(frozen=True, eq=False)
class Optimum:
    """One map of a stretch: where all is, in the frame of what is `fixed`; the rows that speak of it, and what they
    cost there; log det H, how many of the unknowns are `lengths`, and the map's `extent` [m]."""

    values: Values
    fixed: IntArray
    tables: tuple[Table, ...]
    cost: float
    log_determinant: float
    lengths: int
    extent: float

    @classmethod
    def of(cls, values: Values, fixed: IntArray, tables: list[Table]) -> "Optimum":
        """That near a start. Raises SolveError where there is none."""
        system = System(values.layout, tables=tables, fixed=fixed)
        solution = optimise(system, values, QUICK)
        factor = system.factor(solution.values)
        factor.factorise(solution.hessian.numbers)
        lengths = int(np.sum(2 + system.free.kinds % 2))
        extent = float(np.std(solution.values.positions(values.layout.keys, 3), 0).max())
        extent = max(extent, TINY)
        return cls(solution.values, fixed, tuple(tables), solution.cost, factor.log_determinant(), lengths, extent)

    def unlikely(self, extent: float) -> float:
        """-2 log of how likely the rows are, beside a map of some extent, but for what other units change."""
        room = self.log_determinant + 2.0 * self.lengths * np.log(self.extent / extent)
        return self.cost + float(room) - 2.0 * sum(map(log_determinant, self.tables))


def log_determinant(table: Table) -> float:
    """Of all whitening together; directions that tell nothing count for nothing."""
    stretched = np.linalg.svd(table.whitening, compute_uv=False)
    logs = np.log(stretched, where=stretched > 0.0, out=np.zeros_like(stretched))
    return float(logs.sum()) * (len(table) if len(table.whitening) == 1 else 1)


@dataclass(frozen=True, eq=False)
class Trial:
    """A stretch of a team's log. `cost` is that of its optimum (infinite where none is found), `expected` what it
    should be if the model is right. It is sought from the map that `join` makes of it, or `near` that of another
    trial."""

    log: Dataset
    near: "Trial | None" = None

    @classmethod
    def of(cls, log: Dataset) -> "Trial":
        """The stretch as it is written, under a loss that forgives outliers."""
        return cls(log.with_tables(table.with_loss(ROBUST) for table in log.tables))

    @cached_property
    def optima(self) -> tuple[Optimum, ...]:
        """The maps that the stretch makes; none where it cannot be solved."""
        try:
            return tuple(Optimum.of(*start) for start in self._starts())
        except TeamslamError:
            return ()

    def _starts(self) -> Iterator[tuple[Values, IntArray, list[Table]]]:
        if self._nearby is not None:
            yield self._nearby
            return
        for component in self._joined.components if self._joined is not None else ():
            at = AtMap(self.log.tables, component.map)
            yield at.values, frame_of(component.map), at.tables

    @cached_property
    def _nearby(self) -> tuple[Values, IntArray, list[Table]] | None:
        """Where the map of the trial that it is sought near has all of it; None where that has not."""
        near = self.near.optima if self.near is not None else ()
        if len(near) != 1 or not near[0].values.layout.contains(self.log.layout.keys).all():
            return None
        return near[0].values.only(self.log.layout.keys), near[0].fixed, list(self.log.tables)

    @cached_property
    def _joined(self) -> Joined | None:
        """The join of its pieces; None where its odometry is in shreds: that is no log."""
        pieces = split(self.log)
        if len(pieces) > MOST_PIECES * len(self.log.robots):
            return None
        return join([build(piece, options=QUICK) for piece in pieces], options=QUICK)

    @property
    def searched(self) -> int:
        """How many trusses were solved to find where its submaps lie: one takes as long as many stretches without."""
        joined = self._joined if self.optima and self._nearby is None else None
        return joined.searched if joined is not None else 0

    @cached_property
    def values(self) -> Values | None:
        """Where all is, if the stretch makes one map."""
        return self.optima[0].values if len(self.optima) == 1 else None

    @cached_property
    def cost(self) -> float:
        """What the stretch costs once it is solved. What has no place in the map counts as gross misfits."""
        if not self.optima:
            return FAILED
        rows = sum(table.dof for optimum in self.optima for table in optimum.tables)
        return sum(optimum.cost for optimum in self.optima) + LOST * (self.log.dof - rows)

    @cached_property
    def bulk(self) -> float:
        """The cost, but that no row counts for more than one without a place does: a few outliers far off, which cost
        as much with every mistake as without, do not hide that all others fit."""
        if not self.optima:
            return FAILED
        tables = [(table, optimum.values) for optimum in self.optima for table in optimum.tables]
        costs = [np.minimum(t.loss.cost(np.sum(t.whitened(v) ** 2, -1)), LOST * t.ranks).sum() for t, v in tables]
        return float(sum(costs)) + LOST * (self.log.dof - sum(table.dof for table, _ in tables))

    @property
    def extent(self) -> float:
        """Of the largest map [m]; 0 where there is none."""
        return max((optimum.extent for optimum in self.optima), default=0.0)

    def unlikely(self, extent: float) -> float:
        """-2 log of how likely the stretch is, beside a map of some extent, but for what other units change; infinite
        where it cannot be solved."""
        lost = self.cost - sum(optimum.cost for optimum in self.optima)
        return lost + sum(optimum.unlikely(extent) for optimum in self.optima)

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
    def loudness(self) -> float:
        """How many times as large as stated the noise is, squared, outliers counted in full; 1 at least."""
        return max(self.cost / self.expected, self.ratio, 1.0)

    @cached_property
    def ratio(self) -> float:
        """Cost over expected cost, in all (but for outliers, see `bulk`) or of the worst sensor: of one sensor by the
        median of its squared residuals, which few outliers do not move, over twice what that should be."""
        if not self.optima:
            return FAILED
        medians = [float(np.median(s)) for s in self._by_sensor().values() if len(s) >= FEWEST]
        return max([self.bulk / self.expected, *(m / TWICE for m in medians)])

    def _by_sensor(self) -> dict[tuple[int, str, int], Array]:
        """The squared residuals of each robot's rows of each source, of each robot that they see by itself, over what
        their median should be."""
        found: dict[tuple[int, str, int], list[Array]] = {}
        for optimum in self.optima:
            for table in optimum.tables:
                seen = np.maximum(robot_of(table.keys[:, -1]), 0)
                for who in np.unique(seen).tolist():
                    rows = table.select(seen == who)
                    size = beside_median(np.sum(rows.whitened(optimum.values) ** 2, -1), rows.ranks)
                    found.setdefault((table.robot, table.source, who), []).append(size)
        return {sensor: np.concatenate(sizes) for sensor, sizes in found.items()}
