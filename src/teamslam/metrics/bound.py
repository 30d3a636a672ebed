"""The Cramer-Rao bound: how good any unbiased estimate of a simulated team can be.

    covariance >= (J' W J)^-1   at the truth, in the frame of the base pose

J = dh/dx is taken numerically here, in the chart of each variable, from what the sensors predict; a linearisation that
is at hand already (the solver's) can be given instead. Losses do not count: the bound is that of Gaussian noise.
Source: Van Trees, "Detection, Estimation, and Modulation Theory" (1968), 2.4.
"""

from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray
from teamslam.metrics.accuracy import PerNumber
from teamslam.model import Dataset, Kind, Layout, Table, Values
from teamslam.model.sparse import sp

_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Bound:
    """The least covariance of an estimate over `layout`, in the frame of the pose `base`."""

    base: int
    layout: Layout
    covariance: Array

    @property
    def per_number(self) -> PerNumber:
        """What the paper's RMSE in the base frame cannot fall below, on average."""
        return PerNumber.of(self.layout, np.diagonal(self.covariance))


def cramer_rao(dataset: Dataset, base: int | None = None, information: sp.csr_array | None = None) -> Bound:
    """The bound for a simulated dataset; `base` is the first pose of the lowest robot unless given.

    Dense: for problems of up to some thousand unknowns. `information`, optional, is J'WJ over the truth's unknowns in
    the order of its layout, base left out. Raises ModelError where the truth lacks a variable, or where the
    measurements do not determine all of them.
    """
    truth = dataset.truth
    if truth is None or not truth.layout.contains(dataset.layout.keys).all():
        raise ModelError("the bound is taken at the truth, which must be known for every variable; simulate for that")
    base = int(dataset.pose_keys[min(dataset.robots)][0]) if base is None else base
    at = truth.transform(truth.pose(base).inverse())
    layout = at.layout.select(at.layout.keys != base)
    if information is None:
        free = at.layout.unknowns(layout.keys)
        information = information_at(dataset.tables, at)[free][:, free]
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(information.toarray()))
    except np.linalg.LinAlgError:
        raise ModelError("no bound: the measurements do not determine every variable relative to the base") from None
    return Bound(base, layout, inverse.T @ inverse)


def information_at(tables: tuple[Table, ...], values: Values) -> sp.csr_array:
    """J' W J of all tables over all unknowns of `values`."""
    n = values.layout.dof
    total = sp.csr_array((n, n))
    for table in tables:
        jacobian = _jacobian(table, values)
        total = sp.csr_array(total + jacobian.T @ jacobian)
    return total


def _jacobian(table: Table, values: Values) -> sp.csr_array:
    """W dh/dx (rows, unknowns), by central differences.

    Each end of each row gets a variable of its own, so that one sweep moves the same unknown of one end of all rows.
    """
    m, ends = table.keys.shape
    apart, places = _apart(values, table.keys)
    alone = replace(table, keys=places, values=table.predict(values))
    index = values.layout.index(table.keys)
    rows, columns, numbers = [], [], []
    for end in range(ends):
        dofs = values.layout.dofs[index[:, end]]
        starts = apart.layout.dof_start[apart.layout.index(places[:, end])]
        for unknown in range(int(dofs.max(initial=0))):
            has = np.flatnonzero(dofs > unknown)
            step = np.zeros(apart.layout.dof)
            step[starts[has] + unknown] = _STEP
            slope = (alone.whitened(apart.retract(-step)) - alone.whitened(apart.retract(step))) / (2.0 * _STEP)
            r = slope.shape[1]
            rows.append((has[:, None] * r + np.arange(r)).ravel())
            columns.append(np.repeat(values.layout.dof_start[index[has, end]] + unknown, r))
            numbers.append(slope[has].ravel())
    shape = (m * table.row.residual_rows(table.dim), values.layout.dof)
    if not rows:
        return sp.csr_array(shape)
    return sp.csr_array((np.concatenate(numbers), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def _apart(values: Values, keys: IntArray) -> tuple[Values, IntArray]:
    """A copy of each variable for each place in `keys`, and the names of the copies (the places, counted through)."""
    flat = keys.ravel()
    kinds = values.layout.kinds[values.layout.index(flat)]
    copies = {}
    for kind in Kind:
        if len(at := np.flatnonzero(kinds == kind)):
            copies[kind] = (at, values.gather(flat[at], kind))
    return Values.of(copies), np.arange(flat.size).reshape(keys.shape)
