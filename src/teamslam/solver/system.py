"""A least-squares problem: variables, measurement tables and submaps, linearised together.

    F(x) = sum_tables sum_rows rho(|W (z (-) h(x))|^2)  +  sum_submaps |S^ (-) h(G)|^2_I

At x: e(x (+) d) ~ e - J d, so the step solves H d = g with H = sum J'W'W J and g = sum J'W'W e (robust weights inside).
Built-in sensors and submaps are linearised by the native kernel; a sensor that people added to MODELS enters as blocks
made in NumPy. Everything above the kernel speaks of keys and Values, everything below of indices and arrays.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from teamslam import kernel
from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, Array, IntArray
from teamslam.model import Layout, Loss, Names, Submap, Table, Values, pack
from teamslam.model.sparse import sp
from teamslam.solver.linear import Factor, Matrix, analysis_of, block_matrix, by_rising_columns
from teamslam.solver.newton import Curvature
from teamslam.solver.numeric import linearise_numerically


@dataclass(frozen=True, eq=False)
class SubmapTerm:
    """A submap as one big measurement (paper, eq. 11): `values` in the frame of `base`, weighed by `information`.

    `slope` (dof,) is an optional linear part: the term costs e'I e + 2 slope'e with e = S^ (-) h(G); the exact join
    uses it for submaps that are not at their own optimum.
    """

    base: int
    values: Values
    information: sp.csr_array
    slope: Array | None = None

    @classmethod
    def of(cls, submap: Submap) -> "SubmapTerm":
        """The term of a submap at its optimum."""
        return cls(submap.base, submap.values, submap.information)


@dataclass(frozen=True, eq=False)
class Linearised:
    """A problem at one point: its cost, g, and H over the free unknowns, with what `curvature` it holds. H is made when
    it is asked for; `bare` makes the information, which is H without curvature."""

    cost: float
    gradient: Array
    curvature: Curvature
    made: Callable[[], Matrix]
    bare: Callable[[], Matrix]

    @cached_property
    def hessian(self) -> Matrix:
        """H."""
        return self.made()

    @cached_property
    def information(self) -> Matrix:
        """J'W'WJ."""
        return self.hessian if self.curvature == "none" else self.bare()

    @cached_property
    def scale(self) -> Array:
        """The diagonal of the information: how stiffly each unknown is held while the others do not move."""
        return self.information.diagonal()


class System:
    """The problem over the variables of `layout`; those of `fixed` keep their value and have no unknowns.

    `homes` (n,), optional: the place in the layout of the pose that carries each variable when a step is taken, -1 for
    none; to first order the step is the same.
    `tables` and `submaps` may only name variables of the layout; a submap whose base is not among them is written in
    the frame of the problem itself. Raises ModelError for unknown variables or kinds that do not fit.
    """

    def __init__(
        self,
        layout: Layout,
        *,
        tables: Sequence[Table] = (),
        submaps: Iterable[SubmapTerm] = (),
        fixed: AnyArray = (),  # type: ignore[assignment]
        names: Names | None = None,
        homes: IntArray | None = None,
    ) -> None:
        self.layout = layout
        self.names = names or Names()
        self._homes = homes
        self.tables = tuple(tables)
        self.submaps = tuple(term for term in submaps if len(term.values))  # some hold or share but their frame
        held = np.zeros(len(layout), bool)
        held[layout.index(np.asarray(fixed, np.int64))] = True
        self.free = layout.select(~held)
        self._problem = kernel.Problem(layout.kinds.astype(np.int8), held)
        if homes is not None:
            self._problem.set_homes(homes)
        self._handles = [self._add_table(table) for table in self.tables]
        self._all_native = all(table.row.native for table in self.tables)
        self._robust = any(table.row.native and table.loss.name != "squared" for table in self.tables)
        self._submap_handles = self._add_submaps(self.submaps)
        self._analysis: kernel.Analysis | None = None
        self._curvature: Curvature = "none"

    # --- what the optimiser asks --------------------------------------------------------------------------------

    def linearise(self, values: Values, *, curvature: Curvature = "none", lazy: bool = False) -> Linearised:
        """Cost, gradient g and H at `values`.

        `curvature`: what H holds beyond the information J'W'WJ, in which a robust loss is a weight, for steps that
        converge like Newton's (see `newton`). Sensors that people added have no curvature. `lazy`: H is not expected to
        be wanted, and left until it is where that saves work (between submaps, most of it).
        """
        holds: Curvature = curvature if curvature == "all" or self._robust else "none"
        if lazy and self._all_native:
            cost, gradient = self._problem.slope(values.state)
            made = partial(self._hessian, values, holds)
        else:
            self._set_curvature(holds)
            blocks = self._numeric_blocks(values)
            if not all(np.isfinite(J).all() and np.isfinite(cost) for _, J, cost in blocks.values()):
                return self._nowhere(values, holds)
            cost, gradient, numbers = self._problem.linearise(values.state, blocks)
            made = partial(Matrix, self.pattern, numbers, self._analysis)
        return Linearised(cost, gradient, holds, made, partial(self._hessian, values, "none"))

    def factor(self, values: Values) -> Factor:
        """A factor of H, empty as yet. The structure is analysed at the first call, where the positions in `values`
        help; from then on it serves every factor of this system, and of the matrices that `linearise` returns."""
        if self._analysis is None:
            self._analysis = analysis_of(self.free, self.pattern, values)
        return Factor(self.free, self._analysis, names=self.names)

    def cost(self, values: Values) -> float:
        """F at `values`."""
        return float(self._problem.cost(values.state)) + sum(
            table.cost(values) for table in self.tables if not table.row.native
        )

    def retract(self, values: Values, delta: Array) -> Values:
        """values (+) delta over the free unknowns, carried by their homes."""
        return Values(values.layout, self._problem.retract(values.state, delta))

    def chi2(self, values: Values) -> float:
        """The sum of squared whitened residuals, whatever the losses (no factor 1/2)."""
        of_tables = sum(float(np.sum(self.whitened(i, values) ** 2)) for i in range(len(self.tables)))
        if all(table.loss.name == "squared" for table in self.tables):
            return self.cost(values)
        return of_tables

    def whitened(self, table: int, values: Values) -> Array:
        """W e (m, rows) of one table."""
        handle = self._handles[table]
        if self.tables[table].row.native:
            return np.asarray(self._problem.residuals(values.state, handle))
        return self.tables[table].whitened(values)

    def jacobian(self, table: int, values: Values) -> sp.csr_array:
        """W J of one table (m rows, unknowns), J = -de/dx, row by row, without loss or weights."""
        of, known = self.tables[table], self.layout.index(self.tables[table].keys)
        if of.row.native:
            blocks = self._problem.jacobians(values.state, self._handles[table])
        else:
            blocks = np.zeros((len(of), of.row.residual_rows(of.dim), 2 * kernel.MOST_DOF))
            for group in linearise_numerically(of, values):
                blocks[group.rows, :, : group.jacobian.shape[-1]] = group.jacobian
        keys, columns = self.layout.keys[known], np.full((len(of), blocks.shape[-1]), -1)
        unknowns = np.arange(blocks.shape[-1])
        first = np.zeros(len(of), np.int64)
        for slot in range(keys.shape[1]):
            dof, moves = self.layout.dofs[known[:, slot]], self.free.contains(keys[:, slot])
            start = np.full(len(of), -1)
            start[moves] = self.free.dof_start[self.free.index(keys[moves, slot])]
            mine = (unknowns >= first[:, None]) & (unknowns < (first + dof)[:, None]) & moves[:, None]
            columns = np.where(mine, (start - first)[:, None] + unknowns, columns)
            first = first + dof
        moved = np.broadcast_to((columns >= 0)[:, None], blocks.shape)
        ends = np.cumsum(moved.sum(-1).ravel())
        at = np.broadcast_to(columns[:, None], blocks.shape)[moved]
        shape = (blocks.shape[0] * blocks.shape[1], self.free.dof)
        return sp.csr_array((blocks[moved], at, np.concatenate([[0], ends])), shape=shape)

    def along(self, values: Values, y: Array) -> list[Array]:
        """What steps y (unknowns, k) do to the whitened residuals of each table, to first order and without loss or
        weights: W J y (m, rows, k)."""
        y = np.ascontiguousarray(y)
        return [
            np.asarray(self._problem.along(values.state, handle, y))
            if table.row.native
            else np.asarray((self.jacobian(k, values) @ y).reshape(len(table), -1, y.shape[1]))
            for k, (table, handle) in enumerate(zip(self.tables, self._handles, strict=True))
        ]

    def pull(self, values: Values, whitened: Iterable[Array]) -> Array:
        """How the unknowns are pulled by numbers u (m, rows, k) at the rows of each table, asked for one table
        after the other: sum J'W'u (unknowns, k)."""
        sums = None
        for k, (table, handle, u) in enumerate(zip(self.tables, self._handles, whitened, strict=True)):
            sums = np.zeros((self.free.dof, u.shape[2])) if sums is None else sums
            if table.row.native:
                self._problem.pull(values.state, handle, u, sums)
            else:
                sums += self.jacobian(k, values).T @ u.reshape(-1, u.shape[2])
        return np.zeros((self.free.dof, 0)) if sums is None else sums

    def fault(self, table: int, values: Values) -> int | None:
        """The first row of a table of which a residual, its derivative or its cost is not finite; None where all
        are."""
        if self.tables[table].row.native:
            return self._problem.fault(values.state, self._handles[table])
        for group in linearise_numerically(self.tables[table], values):
            numbers = np.concatenate([group.error, group.jacobian.reshape(len(group.rows), -1)], 1)
            if (bad := ~np.isfinite(numbers).all(1)).any():
                return int(group.rows[bad].min())
        return None

    def fault_of_submap(self, which: int, values: Values) -> int | None:
        """The same of a submap: the place of a variable in its estimate."""
        return self._problem.fault(values.state, self._submap_handles[which])

    @property
    def forgives(self) -> bool:
        """Whether a loss may bend the cost down, so that there are saddles between the basins of its rows."""
        return any(table.row.native and table.loss.name not in ("squared", "huber") for table in self.tables)

    def rounding(self, values: Values) -> float:
        """How large the rounding error of one whitened residual can be at `values`, in sigmas."""
        sharpest = [float(np.abs(t.whitening).max(initial=0.0)) for t in self.tables]
        sharpest.append(float(np.sqrt(self._problem.sharpest())))
        return float(np.finfo(float).eps) * max(sharpest) * float(np.abs(values.state).max(initial=1.0))

    @cached_property
    def rows(self) -> int:
        """Numbers measured in all."""
        return sum(table.dof for table in self.tables) + sum(term.values.layout.dof for term in self.submaps)

    @property
    def is_join(self) -> bool:
        """Whether it is of submaps alone: how these bend goes by their variables, not by their numbers."""
        return not self.tables

    @property
    def pattern(self) -> kernel.BlockPattern:
        """Which blocks of H are not zero."""
        return self._problem.pattern

    def set_weights(self, table: int, weights: Array | None) -> None:
        """Extra weights (m,) on the rows of a table, None for one: what graduated non-convexity turns."""
        self._problem.set_weights(self._handles[table], weights)

    def set_whitening(self, table: int, whitening: Array) -> None:
        """Put another whitening (m, r, r) in place of a table's."""
        mine = self.tables[table]
        if mine.row.native:
            self._problem.set_whitening(self._handles[table], whitening)
        tables = list(self.tables)
        tables[table] = replace(mine, whitening=whitening)
        self.tables = tuple(tables)

    def set_submap(self, which: int, term: SubmapTerm) -> None:
        """Put a new estimate, information (of the same structure) and slope in place of a submap's."""
        _, information = block_matrix(term.values.layout, term.information)
        self._problem.set_submap(self._submap_handles[which], term.values.state, information, term.slope)

    def convex(self) -> "System":
        """The same problem with Huber's loss in place of losses that forgive far outliers; itself where there are
        none."""
        if all(table.loss.name in ("squared", "huber") for table in self.tables):
            return self
        tables = [
            t if t.loss.name in ("squared", "huber") else t.with_loss(Loss("huber", t.loss.scale)) for t in self.tables
        ]
        return self.alike(tables, self.submaps)

    def alike(self, tables: Sequence[Table], submaps: Iterable[SubmapTerm]) -> "System":
        """The problem of other measurements of the same variables, of which the same are held."""
        held = self.layout.keys[~self.free.contains(self.layout.keys)]
        return System(self.layout, tables=tables, submaps=submaps, fixed=held, names=self.names, homes=self._homes)

    # --- inside -------------------------------------------------------------------------------------------------

    def _nowhere(self, values: Values, curvature: Curvature) -> Linearised:
        """What there is at a point where a sensor that people added has no finite residual or derivative."""
        nothing = partial(Matrix, self.pattern, np.full(self.pattern.size, np.nan), self._analysis)
        return Linearised(self.cost(values), np.full(self.free.dof, np.nan), curvature, nothing, nothing)

    def _hessian(self, values: Values, curvature: Curvature) -> Matrix:
        return self.linearise(values, curvature=curvature).hessian

    def _set_curvature(self, curvature: Curvature) -> None:
        if curvature == self._curvature:
            return
        native = [h for h, table in zip(self._handles, self.tables, strict=True) if table.row.native]
        for handle in [*native, *self._submap_handles]:
            self._problem.set_curvature(handle, curvature)
        self._curvature = curvature

    # --- building -----------------------------------------------------------------------------------------------

    def _add_table(self, table: Table) -> int:
        index = self.layout.index(table.keys)
        if not table.row.native:
            return int(self._problem.add_blocks(index, table.row.residual_rows(table.dim)))
        sensor = None if table.sensor is None else pack(table.sensor.lift(3) if table.dim == 3 else table.sensor)
        return int(
            self._problem.add_table(
                table.model,
                table.dim,
                index,
                table.values,
                table.whitening,
                sensor=sensor,
                loss=table.loss.name,
                scale=table.loss.scale,
            )
        )

    def _add_submaps(self, terms: Sequence[SubmapTerm]) -> list[int]:
        if not terms:
            return []
        bases = np.array([term.base for term in terms], np.int64)
        known = self.layout.contains(bases)
        frames = np.full(len(terms), -1)
        frames[known] = self.layout.index(bases[known])
        layouts = [term.values.layout for term in terms]
        matrices = [by_rising_columns(term.information) for term in terms]
        sloped = any(term.slope is not None for term in terms)
        slopes = [np.zeros(t.values.layout.dof) if t.slope is None else t.slope for t in terms] if sloped else None
        return self._problem.add_submaps(
            frames,
            [len(layout) for layout in layouts],
            self.layout.index(np.concatenate([layout.keys for layout in layouts])),
            np.concatenate([layout.kinds for layout in layouts]),
            np.concatenate([term.values.state for term in terms]),
            np.concatenate([matrix.indptr for matrix in matrices]),
            [matrix.indices for matrix in matrices],
            [matrix.data for matrix in matrices],
            None if slopes is None else np.concatenate(slopes),
        )

    def _numeric_blocks(self, values: Values) -> dict[int, tuple[Array, Array, float]]:
        blocks = {}
        for table, handle in zip(self.tables, self._handles, strict=True):
            if table.row.native:
                continue
            groups = linearise_numerically(table, values)
            if len(groups) != 1:
                raise ModelError(f"{table.source} ({table.model}): an added sensor needs one kind of variables a table")
            error, jacobian = groups[0].error, groups[0].jacobian
            squared = np.sum(error**2, -1)
            root = np.sqrt(table.loss.weight(squared))
            cost = float(table.loss.cost(squared).sum())
            blocks[handle] = (error * root[:, None], jacobian * root[:, None, None], cost)
        return blocks


Progress = Callable[[str, float], None]
