"""What a log determines, from its own rows at the truth: by singular values of the stacked Jacobian, NumPy alone.

Nothing here knows submaps, starts or joins. The Jacobian is made of differences of the residuals; unknowns are all
variables that the rows speak of, in the chart of `Values`. A direction in which no residual moves is open; how far
others are held is told by the whitened Jacobian. Both are asked of *relations*, numbers that do not depend on where the
frame is: a robot's first pose seen from another's, a landmark seen from a robot, and so on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Dataset, Kind, Table, Values, is_landmark, is_pose, robot_of

STEP = 1e-6  # [m] of a difference, which is good to 1e-9; landmarks may be as near to their sensors
TURN = 1e-4  # [rad] of one that takes in the third derivative, and is good to 1e-11: a lever may be a micron
DENSE = 1000  # unknowns: of more nobody makes a dense matrix here
OPEN = 1e-11  # of the largest: squares of singular values below are none. Differences are good to 1e-9


class TooLarge(Exception):
    """A log with more unknowns than a dense matrix is made of."""


def centred(tables: Sequence[Table], values: Values) -> tuple[list[Table], Values]:
    """The same problem about the origin: differences far from it would only be rounding."""
    if not len(values):
        return list(tables), values
    flat = bool((values.layout.kinds % 2 == 0).any())
    far = values.positions(values.layout.keys, 3).mean(0) * ([1.0, 1.0, 0.0] if flat else 1.0)
    dim = 2 if flat else 3
    moved = [_moved(t, -far) if t.row.unary else t for t in tables]
    return moved, values.transform(Pose(np.eye(dim), -far[:dim]))


def _moved(table: Table, shift: Array) -> Table:
    values = table.values.copy()
    values[:, : table.dim] += shift[: table.dim]
    return replace(table, values=values)


def spoken_of(tables: Sequence[Table]) -> IntArray:
    """The keys that some row names."""
    return np.unique(np.concatenate([t.keys.ravel() for t in tables] or [np.zeros(0, np.int64)]))


def true_values(log: Dataset) -> Values:
    """The truth of the variables that the log speaks of, each of the kind that the log makes it."""
    assert log.truth is not None
    parts = {}
    for kind in Kind:
        keys = log.layout.keys_of(kind)
        if len(keys):
            data = log.truth.poses_of(keys, kind.dim) if kind.is_pose else log.truth.positions(keys, kind.dim)
            parts[kind] = (keys, data)
    return Values.of(parts)


def jacobian(tables: Sequence[Table], values: Values) -> Array:
    """de/dx (rows, dof) of all tables, in metres and radians."""
    layout = values.layout
    starts = np.cumsum([0] + [_size(t) for t in tables])
    out = np.zeros((int(starts[-1]), layout.dof))
    for table, start in zip(tables, starts[:-1].tolist(), strict=True):
        rows = start + np.arange(_size(table)).reshape(len(table), -1)
        ends = table.ends(values)
        for end, variable in enumerate(table.keys[:, [0, -1]].T):
            if ends[end] is None:
                continue
            slopes = _slopes(table, ends, end)  # (m, rows, d)
            places = layout.index(variable)
            for kind in np.unique(layout.kinds[places]).tolist():
                of_kind = np.flatnonzero(layout.kinds[places] == kind)
                lifted, own = _unknowns(Kind(kind), ends[end])
                columns = layout.dof_start[places[of_kind], None] + own
                block = slopes[of_kind][:, :, lifted]
                out[rows[of_kind][:, :, None], columns[:, None, :]] += block
    return out


def _size(table: Table) -> int:
    """Numbers in the residuals of all its rows."""
    return len(table) * table.row.residual_rows(table.dim)


def _slopes(table: Table, ends: tuple[Pose | None, Pose | Array], end: int) -> Array:
    """de (m, rows, d) by differences of one end's tangent, d of its own dimension."""
    moving = ends[end]
    size = moving.dof if isinstance(moving, Pose) else moving.shape[-1]
    out = np.zeros((len(table), table.row.residual_rows(table.dim), size))

    def across(k: int, step: float) -> Array:
        """How much the residuals differ from a step back to a step on."""
        shift = np.zeros((len(table), size))
        shift[:, k] = step
        moved = [moving.retract(s) if isinstance(moving, Pose) else moving + s for s in (shift, -shift)]
        both = [(there, ends[1]) if end == 0 else (ends[0], there) for there in moved]
        after, before = (table.row.minus(table.values, table.predict_from(*pair), table.dim) for pair in both)
        return np.asarray(after - before)

    for k in range(size):
        if isinstance(moving, Pose) and k >= moving.dim:
            out[:, :, k] = (8.0 * across(k, TURN) - across(k, 2.0 * TURN)) / (12.0 * TURN)
        else:
            out[:, :, k] = across(k, STEP) / (2.0 * STEP)
    return out


def _unknowns(kind: Kind, end: Pose | Array) -> tuple[list[int], list[int]]:
    """Which numbers of an end's tangent are unknowns of a variable of a kind, and which ones."""
    if not isinstance(end, Pose):  # where it is, alone
        common = list(range(min(kind.dim, end.shape[-1])))
        return common, common
    if kind.dim == end.dim:
        return list(range(kind.dof)), list(range(kind.dof))
    return [0, 1, 5], [0, 1, 2]


def whitened(tables: Sequence[Table], matrix: Array) -> Array:
    """W times the rows of a Jacobian."""
    return _times([t.whitening for t in tables], tables, matrix)


def _measured(tables: Sequence[Table], matrix: Array) -> Array:
    """The rows of a Jacobian, each without the directions of its residual that it knows to no finite sigma."""
    return _times([np.linalg.pinv(t.whitening, rcond=1e-14) @ t.whitening for t in tables], tables, matrix)


def _times(factors: Sequence[Array], tables: Sequence[Table], matrix: Array) -> Array:
    parts, at = [], 0
    for factor, table in zip(factors, tables, strict=True):
        size = _size(table)
        block = matrix[at : at + size].reshape(len(table), -1, matrix.shape[1])
        parts.append((factor @ block).reshape(size, -1))
        at += size
    return np.concatenate(parts or [matrix])


@dataclass(frozen=True, eq=False)
class Oracle:
    """A log with its truth, and what its rows determine there."""

    log: Dataset

    @cached_property
    def _centred(self) -> tuple[list[Table], Values]:
        return centred([t for t in self.log.tables if len(t)], true_values(self.log))

    @property
    def tables(self) -> list[Table]:
        """All tables with a row, those of the world moved to where the log is."""
        return self._centred[0]

    @property
    def truth(self) -> Values:
        """Of all variables that rows speak of, about the origin."""
        return self._centred[1]

    @cached_property
    def absolute(self) -> bool:
        """Whether something was measured in the world."""
        return any(t.row.unary for t in self.tables)

    @cached_property
    def _decomposed(self) -> tuple[Array, Array]:
        """The open directions (dof, k), and a root S (dof, m) of the covariance of the rest: S S' = pinv(J'J)."""
        if self.truth.layout.dof > DENSE:
            raise TooLarge
        plain = _measured(self.tables, jacobian(self.tables, self.truth))
        squares, directions = np.linalg.eigh(plain.T @ plain)
        loose = squares <= OPEN * max(float(squares.max(initial=0.0)), 1.0)
        held = directions[:, ~loose]
        triangle = np.linalg.qr(whitened(self.tables, plain) @ held, mode="r")
        scale = np.linalg.norm(triangle, axis=0)
        return directions[:, loose], held @ (np.linalg.pinv(triangle / scale, rcond=1e-13) / scale[:, None])

    def freedom(self, relation: Array) -> int:
        """How many directions of a relation, given by its Jacobian (r, dof), no row holds."""
        loose = relation @ self._decomposed[0]
        if not loose.size:
            return 0
        return int((np.linalg.svd(loose, compute_uv=False) > 1e-5).sum())

    def sigmas(self, relation: Array) -> Array:
        """The standard deviations (r,) of a relation, infinite where it is open."""
        loose, root = self._decomposed
        out = np.sqrt(np.sum((relation @ root) ** 2, -1))
        return np.where(np.abs(relation @ loose).max(-1, initial=0.0) > 1e-6, np.inf, out)

    # --- relations --------------------------------------------------------------------------------------------

    def between(self, one: int, other: int) -> Array:
        """The Jacobian (3 or 6 or 2, dof) of a variable seen from a pose: translation, then rotation if it is one."""
        layout, dim = self.truth.layout, self._dim(one, other)
        out = np.zeros((self._seen(self.truth, one, other, dim).shape[-1], layout.dof))
        for column in layout.unknowns(np.array([one, other])).tolist():
            step = np.zeros(layout.dof)
            step[column] = STEP
            ends = [self._seen(self.truth.retract(s), one, other, dim) for s in (step, -step)]
            out[:, column] = (ends[0] - ends[1]) / (2.0 * STEP)
        return out

    def _dim(self, one: int, other: int) -> int:
        layout = self.truth.layout
        return 2 + int((layout.kinds[layout.index(np.array([one, other]))] % 2).max())

    def _seen(self, values: Values, one: int, other: int, dim: int) -> Array:
        frame, here = values.pose(one).lift(dim), self.truth.pose(one).lift(dim)
        kind = Kind(int(self.truth.layout.kinds[self.truth.layout.index(other)]))
        if not kind.is_pose:
            return frame.unact(values.positions(np.array(other), dim))
        seen = frame.between(values.pose(other).lift(dim))
        return seen.minus(here.between(self.truth.pose(other).lift(dim)))

    # --- what is asked ----------------------------------------------------------------------------------------

    @cached_property
    def robots(self) -> dict[int, IntArray]:
        """The poses of each robot that rows speak of, rising."""
        keys = self.truth.layout.keys
        own = {int(r): np.sort(keys[robot_of(keys) == r]) for r in np.unique(robot_of(keys[is_pose(keys)]))}
        return own

    @cached_property
    def landmarks(self) -> IntArray:
        """The landmarks that rows speak of."""
        keys = self.truth.layout.keys
        return np.sort(keys[is_landmark(keys)])


def lever(oracle: Oracle, one: int, other: int) -> float:
    """How far apart two variables truly are [m], at least one."""
    dim = 3
    ends = oracle.truth.positions(np.array([one, other]), dim)
    return max(1.0, float(np.linalg.norm(ends[1] - ends[0])))
