"""Jacobians by differences, for sensors that people add and for tests of those that are built in.

A sensor is one row of MODELS, with no derivative to write: e(x (+) d) ~ e - J d is differentiated in the chart of each
variable, centrally, all rows at once. The kinds of observer and target may vary within a table, so the rows are
grouped.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Kind, Table, Values

_STEP = 1e-6  # the cube root of double precision, on variables of size one


@dataclass(frozen=True, eq=False)
class Group:
    """Rows of a table whose variables are of the same kinds: `rows` (m,) of the table, `index` (m, k) of the variables
    in the layout, whitened residual `error` (m, r) and `jacobian` J = -de/dx (m, r, unknowns of one row)."""

    rows: IntArray
    index: IntArray
    error: Array
    jacobian: Array


def linearise_numerically(table: Table, values: Values) -> list[Group]:
    """The whitened residuals of a table and their Jacobians at `values`, unweighted, grouped by kinds of variables."""
    index = values.layout.index(table.keys)
    kinds = values.layout.kinds[index]
    groups = []
    for pair in np.unique(kinds, axis=0):
        rows = np.flatnonzero((kinds == pair).all(1))
        groups.append(_group(table.select(rows), values, rows, index[rows], [Kind(int(k)) for k in pair]))
    return groups


def _group(table: Table, values: Values, rows: IntArray, index: IntArray, kinds: list[Kind]) -> Group:
    variables = [values.gather(table.keys[:, slot], kind) for slot, kind in enumerate(kinds)]

    def error(moved: list[Pose | Array]) -> Array:
        target = moved[-1]
        if isinstance(target, Pose) and not table.row.targets_pose:
            target = target.translation
        h = table.predict_from(None if table.row.unary else _as_pose(moved[0]), target)
        return np.asarray((table.whitening @ table.row.minus(table.values, h, table.dim)[..., None])[..., 0])

    columns = []
    for slot, kind in enumerate(kinds):
        for unknown in range(kind.dof):
            step = np.zeros(kind.dof)
            step[unknown] = _STEP
            ahead, behind = list(variables), list(variables)
            ahead[slot], behind[slot] = _move(variables[slot], step), _move(variables[slot], -step)
            columns.append((error(behind) - error(ahead)) / (2.0 * _STEP))
    return Group(rows, index, error(variables), np.stack(columns, -1))


def _move(variable: Pose | Array, step: Array) -> Pose | Array:
    if isinstance(variable, Pose):
        return variable.retract(np.broadcast_to(step, (*variable.batch, len(step))))
    return variable + step


def _as_pose(variable: Pose | Array) -> Pose:
    assert isinstance(variable, Pose)
    return variable
