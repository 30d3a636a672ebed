"""All rows of a log at a map, linearised once: what calibration is computed from.

    e_i(x (+) d, p)  ~  e_i - J_i d - D_i p          in the units of the measurement, not whitened

`J` is sparse over the free unknowns of the map, D_i are the effects of systematic errors (see `terms`), one column for
each term of each table. Noise enters later, as whitening matrices that calibration changes while these stay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
class Linear:
    """The rows of `tables` one after another, N numbers in all, `at` a map.

    `errors` (N,) at the map, `jacobian` sparse (N, unknowns), `effects` sparse (N, k) of the
    systematic errors `columns` that these tables may have, in units of their first guesses; all unwhitened.
    """

    at: AtMap
    tables: tuple[Table, ...]
    errors: Array
    jacobian: sp.csr_array
    columns: tuple[Column, ...]
    effects: sp.csc_array

    def by_tables(self, stacked: Array) -> list[Array]:
        """Numbers (N, ...) of all rows as (m, rows, ...) of each table."""
        shapes = [(len(t), t.row.residual_rows(t.dim)) for t in self.tables]
        ends = np.cumsum([m * rows for m, rows in shapes])[:-1]
        return [
            part.reshape(*shape, *stacked.shape[1:])
            for part, shape in zip(np.split(stacked, ends), shapes, strict=True)
        ]

    @property
    def names(self) -> Names:
        """What robots and landmarks are called."""
        return self.at.joined.names

    @property
    def groups(self) -> IntArray:
        """Which kind of error each column is (k,): the same term of the same sensor of any robot. `relative` terms of
        all sensors are of one kind."""
        kinds = [
            (c.term.name, *([] if c.term.relative else [self.tables[c.table].source, self.tables[c.table].model]))
            for c in self.columns
        ]
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
    both = linearised(at.tables, values, held_at(at), names)
    errors, jacobians, columns = [], [], []
    for place, (table, (error, jacobian)) in enumerate(zip(at.tables, both, strict=True)):
        rate = np.zeros_like(error) if velocity is None else -(jacobian @ velocity).reshape(error.shape)
        scene = scene_of(table, values, lasting_of(table, names), rate)
        for term, landmark, effect in effects_of(scene):
            if (size := term.size(scene)) > 0.0:
                columns.append(Column(term, place, effect, size, landmark))
        errors.append(error.ravel())
        jacobians.append(jacobian)
    starts = np.cumsum([0, *map(len, errors)])
    whole = sp.csr_array(sp.vstack(jacobians))
    return Linear(
        at, tuple(at.tables), np.concatenate(errors), whole, tuple(columns),
        _effects(columns, starts),
    )  # fmt: skip


def held_at(at: AtMap) -> IntArray:
    """The variables that do not move at a map."""
    keys = at.values.layout.keys
    return np.asarray(keys[~at.gap.free.contains(keys)])


def _effects(columns: Sequence[Column], starts: IntArray) -> sp.csc_array:
    """What one first guess of each error does to all rows (N, k)."""
    nothing, none = [np.zeros(0)], [np.zeros(0, np.int64)]
    data = np.concatenate([c.size * c.effect.ravel() for c in columns] or nothing)
    rows = np.concatenate([starts[c.table] + np.arange(c.effect.size) for c in columns] or none)
    ends = np.cumsum([0, *(c.effect.size for c in columns)])
    return sp.csc_array((data, rows, ends), shape=(int(starts[-1]), len(columns)))


def linearised(
    tables: Sequence[Table], values: Values, held: IntArray, names: Names
) -> list[tuple[Array, sp.csr_array]]:
    """Residuals e (m, rows) and J = -de/dx (m rows, unknowns) of each table, unwhitened; what is `held` does not
    move."""
    bare = [replace(t, whitening=np.eye(t.row.residual_rows(t.dim))[None], loss=SQUARED) for t in tables]
    system = System(values.layout, tables=bare, fixed=held, names=names)
    return [(system.whitened(k, values), system.jacobian(k, values)) for k in range(len(bare))]


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
