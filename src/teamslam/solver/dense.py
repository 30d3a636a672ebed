"""A few rows linearised by themselves, dense: for estimates that change with every measurement (see `System` for the
rest)."""

import numpy as np

from teamslam import kernel
from teamslam.geometry import Array, IntArray
from teamslam.model import Layout, Table, Values, pack
from teamslam.model.layout import KIND_SIZE, rows_of
from teamslam.solver.numeric import linearise_numerically


def normal_equations(table: Table, keys: IntArray, kinds: IntArray, state: Array) -> tuple[float, Array, Array]:
    """Cost, H (n, n) and g (n,) of a table over all unknowns of some variables, in the order of `keys` (k,), which may
    be any; robust weights inside. `state` holds the variables' numbers in the same order, as in `Values`.

    Law: the same as `System` gives. Raises ModelError where the table names others, or kinds that do not fit.
    """
    if table.row.native:
        index = _places(table.keys, keys)
        mount = None if table.sensor is None else table.sensor.lift(3) if table.dim == 3 else table.sensor
        return kernel.normal_equations(
            kinds, state, table.model, table.dim, index, table.values, table.whitening,
            None if mount is None else pack(mount), table.loss.name, table.loss.scale,
        )  # fmt: skip
    return _numerically(table, keys, kinds, state)


def _places(wanted: IntArray, keys: IntArray) -> IntArray:
    order = np.argsort(keys)
    return np.asarray(order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)])


def _numerically(table: Table, keys: IntArray, kinds: IntArray, state: Array) -> tuple[float, Array, Array]:
    """The same for a sensor that people added."""
    layout = Layout.of(keys, kinds)
    sizes = KIND_SIZE[kinds]
    starts = np.cumsum(sizes) - sizes
    order = _places(layout.keys, keys)
    values = Values(layout, state[rows_of(starts[order], sizes[order])])
    columns = layout.unknowns(keys)
    H, g, cost = np.zeros((layout.dof, layout.dof)), np.zeros(layout.dof), 0.0
    for group in linearise_numerically(table, values):
        squared = np.sum(group.error**2, -1)
        weight = table.loss.weight(squared)
        cost += float(table.loss.cost(squared).sum())
        for row, index in enumerate(group.index):
            at = rows_of(layout.dof_start[index], layout.dofs[index])
            J = group.jacobian[row]
            H[np.ix_(at, at)] += weight[row] * J.T @ J
            g[at] += weight[row] * J.T @ group.error[row]
    return cost, H[np.ix_(columns, columns)], g[columns]
