"""A few rows linearised by themselves, dense: for estimates that change with every measurement (see `System` for the
rest)."""

import numpy as np

from teamslam import kernel
from teamslam.geometry import AnyArray, Array, IntArray
from teamslam.kernel import Gaussian
from teamslam.model import Layout, Table, Values, pack
from teamslam.model.layout import KIND_SIZE, rows_of
from teamslam.solver.numeric import Group, linearise_numerically


def normal_equations(table: Table, keys: IntArray, kinds: IntArray, state: Array) -> tuple[float, Array, Array]:
    """Cost, H (n, n) and g (n,) of a table over all unknowns of some variables, in the order of `keys` (k,), which may
    be any; robust weights inside. `state` holds the variables' numbers in the same order, as in `Values`.

    Law: the same as `System` gives. Raises ModelError where the table names others, or kinds that do not fit.
    """
    if table.row.native:
        return kernel.normal_equations(kinds, state, *_native(table, _places(table.keys, keys)))
    return _numerically(table, keys, kinds, state)


def moved(given: Gaussian, key: int, table: Table, step: Array) -> tuple[Array, Array] | None:
    """State and covariance of a robot's filter at a new pose, by a table's rows between its pose of now X, `key`, and
    that one; all else is held where it is. `step`, what the first row measured, says where it begins.

    None where the rows leave the new pose open or are not finite. Raises ModelError for kinds that they do not relate.
    """
    index = np.asarray(table.keys != key, np.int64)
    first = table.keys[0].tolist()
    backward = first[0] != key
    both = np.array(first[::-1] if backward else first)
    rows = _rows(table, index, both, np.repeat(given.kinds[:1], 2))
    return kernel.moved(given, rows, step, backward, len(table) == 1)


def seen(
    given: Gaussian, keys: IntArray, table: Table, index: IntArray, most: int, little: float
) -> tuple[Array, Array] | None:
    """State and covariance of a robot's filter over the variables `keys`, sharpened by a table's rows, of which `index`
    (m, keys) names the places. They are linearised anew, `most` times at most, while the pose of now or the sight of
    things turns by more than `little` [rad].

    None where they are not finite. Raises ModelError for kinds that they do not relate.
    """
    return kernel.seen(given, _rows(table, index, keys, given.kinds), most, little)


def told(given: Gaussian, known: Gaussian, theirs: IntArray, fresh: IntArray) -> tuple[Array, Array] | None:
    """State and covariance of a robot's filter with more variables at its end: those at the places `fresh` of what a
    map knows, given what the filter holds of it. That is what does not turn in it, at the places `theirs` in the map.

    None where these hang together so firmly that nothing can be said. Raises ModelError where kinds differ.
    """
    return kernel.told(given, known, theirs, fresh)


def _rows(table: Table, index: IntArray, keys: IntArray, kinds: AnyArray) -> kernel.Rows:
    if table.row.native:
        return kernel.table_arguments(*_native(table, index))
    kinds = np.asarray(kinds, np.int64)
    used = np.unique(index)
    sizes = KIND_SIZE[kinds]
    numbers = rows_of((np.cumsum(sizes) - sizes)[used], sizes[used])
    return kernel.UserRows(
        index, table.row.residual_rows(table.dim),
        lambda state: _rows_numerically(table, keys[used], kinds[used], state[numbers]),
    )  # fmt: skip


def _native(table: Table, index: IntArray) -> tuple[str, int, IntArray, Array, Array, Array | None, str, float]:
    mount = None if table.sensor is None else table.sensor.lift(3) if table.dim == 3 else table.sensor
    return (
        table.model, table.dim, index, table.values, table.whitening,
        None if mount is None else pack(mount), table.loss.name, table.loss.scale,
    )  # fmt: skip


def _places(wanted: IntArray, keys: IntArray) -> IntArray:
    order = np.argsort(keys)
    return np.asarray(order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)])


def _numerically(table: Table, keys: IntArray, kinds: IntArray, state: Array) -> tuple[float, Array, Array]:
    """The same for a sensor that people added."""
    layout, groups = _groups(table, keys, kinds, state)
    columns = layout.unknowns(keys)
    H, g, cost = np.zeros((layout.dof, layout.dof)), np.zeros(layout.dof), 0.0
    for group in groups:
        squared = np.sum(group.error**2, -1)
        weight = table.loss.weight(squared)
        cost += float(table.loss.cost(squared).sum())
        for row, index in enumerate(group.index):
            at = rows_of(layout.dof_start[index], layout.dofs[index])
            J = group.jacobian[row]
            H[np.ix_(at, at)] += weight[row] * J.T @ J
            g[at] += weight[row] * J.T @ group.error[row]
    return cost, H[np.ix_(columns, columns)], g[columns]


def _rows_numerically(table: Table, keys: IntArray, kinds: IntArray, state: Array) -> tuple[Array, Array]:
    """Its rows one by one: e (m, r) and J (m, r, 12), whitened and weighted."""
    size = table.row.residual_rows(table.dim)
    e, J = np.zeros((len(table), size)), np.zeros((len(table), size, 2 * kernel.MOST_DOF))
    for group in _groups(table, keys, kinds, state)[1]:
        root = np.sqrt(table.loss.weight(np.sum(group.error**2, -1)))[:, None]
        e[group.rows] = root * group.error
        J[group.rows, :, : group.jacobian.shape[-1]] = root[..., None] * group.jacobian
    return e, J


def _groups(table: Table, keys: IntArray, kinds: IntArray, state: Array) -> tuple[Layout, list[Group]]:
    layout = Layout.of(keys, kinds)
    sizes = KIND_SIZE[kinds]
    starts = np.cumsum(sizes) - sizes
    order = _places(layout.keys, keys)
    return layout, linearise_numerically(table, Values(layout, state[rows_of(starts[order], sizes[order])]))
