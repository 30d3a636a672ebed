"""All rows of a log at a map, linearised once: what calibration is computed from.

    e_i(x (+) d, p)  ~  e_i - J_i d - D_i p          in the units of the measurement, not whitened

`J` is sparse over the free unknowns of the map, D_i are the effects of systematic errors (see `terms`), one column for
each term of each table. Noise enters later, as whitening matrices that calibration changes while these stay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import AtMap
from teamslam.model import Layout, Names, Table, Values, is_pose, robot_of
from teamslam.model.losses import SQUARED
from teamslam.model.sparse import sp
from teamslam.solver import System
from teamslam.trust.calibration.terms import Term, effects_of, scene_of


@dataclass(frozen=True, eq=False)
class Column:
    """One term of one table: its place in `Linear.tables`, its `effect` (m, rows), and `size`, a first guess
    of how large p is; the landmark that it is of, 0 where it is of all."""

    term: Term
    table: int
    effect: Array
    size: float
    landmark: int = 0


@dataclass(frozen=True, eq=False)
class Effects:
    """What some systematic errors do to all rows, D (N, k): of each table the `places` of its own among them and what
    they do to its rows (m rows, own), all others are nothing to it; and their `count` k."""

    places: tuple[IntArray, ...]
    own: tuple[Array, ...]
    count: int

    @classmethod
    def of(cls, tables: Sequence[Table], numbers: Sequence[int], columns: Sequence[Column]) -> "Effects":
        """One first guess of each of `columns`, on tables of these numbers."""
        places = [np.array([k for k, c in enumerate(columns) if c.table == n], np.int64) for n in numbers]
        sizes = [len(table) * table.row.residual_rows(table.dim) for table in tables]
        own = [
            np.stack([columns[k].size * columns[k].effect.ravel() for k in mine], -1) if len(mine) else np.zeros((m, 0))
            for mine, m in zip(places, sizes, strict=True)
        ]
        return cls(tuple(places), tuple(own), len(columns))

    def only(self, which: IntArray) -> "Effects":
        """Those at some places, rising."""
        places, own = [], []
        for mine, effects in zip(self.places, self.own, strict=True):
            kept = np.isin(mine, which)
            places.append(np.searchsorted(which, mine[kept]))
            own.append(effects if kept.all() else np.ascontiguousarray(effects[:, kept]))
        return Effects(tuple(places), tuple(own), len(which))

    def toarray(self) -> Array:
        """D (N, k)."""
        out = np.zeros((sum(map(len, self.own)), self.count))
        self.along(-np.eye(self.count), out)
        return out

    def along(self, values: Array, out: Array) -> None:
        """Takes D values (N, draws) from `out`, for values (k, draws)."""
        first = 0
        for mine, effects in zip(self.places, self.own, strict=True):
            if len(mine):
                out[first : first + len(effects)] -= effects @ values[mine]
            first += len(effects)

    def pull(self, numbers: Array) -> Array:
        """D' numbers (k, draws), for numbers (N, draws)."""
        out, first = np.zeros((self.count, *numbers.shape[1:])), 0
        for mine, effects in zip(self.places, self.own, strict=True):
            if len(mine):
                out[mine] = effects.T @ numbers[first : first + len(effects)]
            first += len(effects)
        return out


@dataclass(frozen=True, eq=False)
class Linear:
    """The rows of `tables` one after another, N numbers in all, `at` a map.

    `errors` (N,) at the map, `jacobian` sparse (N, unknowns), systematic errors `columns` that these tables may have;
    all unwhitened. `system`: the problem of all rows at the map, whose whitening fits put in, and `places` where the
    tables are among its own.
    """

    at: AtMap
    tables: tuple[Table, ...]
    errors: Array
    jacobian: sp.csr_array
    columns: tuple[Column, ...]
    system: System
    places: tuple[int, ...]

    def only(self, which: Sequence[int]) -> "Linear":
        """The rows of the tables at some places, rising."""
        rows = [np.arange(a, b) for k, (a, b) in enumerate(pairwise(self.starts)) if k in which]
        mine = np.concatenate([*rows, np.zeros(0, np.int64)])
        return replace(
            self,
            tables=tuple(self.tables[k] for k in which),
            errors=self.errors[mine],
            jacobian=self.jacobian[mine],
            places=tuple(self.places[k] for k in which),
        )

    def by_tables(self, stacked: Array) -> list[Array]:
        """Numbers (N, ...) of all rows as (m, rows, ...) of each table."""
        parts = (stacked[first:end] for first, end in pairwise(self.starts))
        return [
            part.reshape(len(table), table.row.residual_rows(table.dim), *stacked.shape[1:])
            for part, table in zip(parts, self.tables, strict=True)
        ]

    @cached_property
    def starts(self) -> list[int]:
        """Where the numbers of each table begin, and where the last ones end."""
        return [0, *accumulate(len(t) * t.row.residual_rows(t.dim) for t in self.tables)]

    @cached_property
    def jacobians(self) -> list[sp.csr_array]:
        """J of each table (m rows, unknowns)."""
        whole, starts = self.jacobian, self.jacobian.indptr
        return [
            sp.csr_array(
                (
                    whole.data[starts[a] : starts[b]],
                    whole.indices[starts[a] : starts[b]],
                    starts[a : b + 1] - starts[a],
                ),
                shape=(b - a, whole.shape[1]),
            )
            for a, b in pairwise(self.starts)
        ]

    @cached_property
    def blocks(self) -> tuple[IntArray, IntArray]:
        """Columns and row starts of a matrix (N, N) by rows that has a block for each row of a table."""
        columns, counts = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for table, first in zip(self.tables, self.starts[:-1], strict=True):
            m, r = len(table), table.row.residual_rows(table.dim)
            places = first + np.arange(m * r).reshape(m, 1, r)
            columns.append(np.broadcast_to(places, (m, r, r)).ravel())
            counts.append(np.full(m * r, r))
        return np.concatenate(columns), np.concatenate([[0], np.cumsum(np.concatenate(counts))])

    @cached_property
    def effects(self) -> "Effects":
        """What one first guess of each systematic error does."""
        return Effects.of(self.tables, self.places, self.columns)

    @property
    def names(self) -> Names:
        """What robots and landmarks are called."""
        return self.at.joined.names

    @property
    def groups(self) -> IntArray:
        """Which kind of error each column is (k,): the same term of the same sensor of any robot. `relative` terms of
        all sensors are of one kind."""
        kinds = [(c.term.name, *([] if c.term.relative else self.at.tables[c.table].kind[:2])) for c in self.columns]
        known = {kind: number for number, kind in enumerate(dict.fromkeys(kinds))}
        return np.array([known[kind] for kind in kinds], np.int64)

    @property
    def relative(self) -> BoolArray:
        """Whether only how errors of its kind differ is seen of each column (k,)."""
        return np.array([c.term.relative for c in self.columns], bool)


def linear_at(at: AtMap) -> Linear:
    """The rows of a log at a map. Raises SolveError where they do not determine it."""
    free, names, values = at.gap.system.free, at.joined.names, at.values
    velocity = None if names.counts else velocities(values, free, names)
    system = bare(at.tables, values, held_at(at), names)
    both = [(system.whitened(k, values), system.jacobian(k, values)) for k in range(len(at.tables))]
    errors, jacobians, columns = [], [], []
    for place, (table, (error, jacobian)) in enumerate(zip(at.tables, both, strict=True)):
        rate = np.zeros_like(error) if velocity is None else -(jacobian @ velocity).reshape(error.shape)
        scene = scene_of(table, values, lasting_of(table, names), rate)
        for term, landmark, effect in effects_of(scene):
            if (size := term.size(scene)) > 0.0:
                columns.append(Column(term, place, effect, size, landmark))
        errors.append(error.ravel())
        jacobians.append(jacobian)
    whole = sp.csr_array(sp.vstack(jacobians))
    places = tuple(range(len(at.tables)))
    return Linear(at, tuple(at.tables), np.concatenate(errors), whole, tuple(columns), system, places)


def held_at(at: AtMap) -> IntArray:
    """The variables that do not move at a map."""
    keys = at.values.layout.keys
    return np.asarray(keys[~at.gap.free.contains(keys)])


def linearised(
    tables: Sequence[Table], values: Values, held: IntArray, names: Names
) -> list[tuple[Array, sp.csr_array]]:
    """Residuals e (m, rows) and J = -de/dx (m rows, unknowns) of each table, unwhitened; what is `held` does not
    move."""
    system = bare(tables, values, held, names)
    return [(system.whitened(k, values), system.jacobian(k, values)) for k in range(len(tables))]


def bare(tables: Sequence[Table], values: Values, held: IntArray, names: Names) -> System:
    """The problem of rows that are neither whitened nor under a loss; what is `held` does not move."""
    stripped = [replace(t, whitening=np.eye(t.row.residual_rows(t.dim))[None], loss=SQUARED) for t in tables]
    return System(values.layout, tables=stripped, fixed=held, names=names)


def velocities(values: Values, free: Layout, names: Names) -> Array:
    """How fast every unknown changes along the robots' ways (unknowns,): of poses by their neighbours in time, of what
    stands still zero."""
    out = np.zeros(free.dof)
    poses = values.layout.keys[is_pose(values.layout.keys)]
    for robot in np.unique(robot_of(poses)).tolist():
        keys = np.sort(poses[robot_of(poses) == robot])
        if len(keys) < 2:
            continue
        dim = 2 if values.layout.kinds[values.layout.index(keys[0])] == 0 else 3
        way, stamps = values.poses_of(keys, dim), names.stamps_s(keys)
        here = np.arange(len(keys))
        before, after = np.maximum(here - 1, 0), np.minimum(here + 1, len(keys) - 1)
        rate = way[after].minus(way[before]) / np.maximum(stamps[after] - stamps[before], 1e-9)[:, None]
        moves = free.contains(keys)
        start = free.dof_start[free.index(keys[moves])]
        out[start[:, None] + np.arange(rate.shape[1])] = rate[moves]
    return out


def lasting_of(table: Table, names: Names) -> Array:
    """The time between the two ends of each row (m,) [s]; poses that are only counted are 1 apart."""
    if table.keys.shape[1] < 2 or not is_pose(table.keys).all():
        return np.zeros(len(table))
    stamps = names.stamps_s(table.keys)
    return np.asarray(np.abs(stamps[:, 1] - stamps[:, 0]))


def is_sighting(table: Table) -> bool:
    """Whether its errors may hang together: those of odometry are taken to be independent, as increments are."""
    return table.source != "odometry" and not table.row.unary and len(table) > 1
