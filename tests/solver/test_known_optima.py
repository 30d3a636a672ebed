"""Optima of published logs, held against NumPy's residuals, their differences, and SciPy's sparse algebra.

Nothing of the kernel is asked: residuals are the laws in MODELS, Jacobians are differences of one end's tangent, steps
are solved by SuperLU.
"""

from collections.abc import Sequence

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from teamslam.geometry import Array, IntArray, Pose
from teamslam.io import read
from teamslam.joining import full
from teamslam.model import Table, Values

STEP = 1e-6


def whitened(tables: Sequence[Table], values: Values) -> Array:
    return np.concatenate([table.whitened(values).ravel() for table in tables])


def jacobian(tables: Sequence[Table], values: Values, free: IntArray) -> sp.csc_array:
    """Of the whitened residuals by the free unknowns, sparse."""
    blocks = []
    for table in tables:
        ends = table.ends(values)
        size = table.row.residual_rows(table.dim)
        whole = sp.csc_array((len(table) * size, values.layout.dof))
        for place, end in enumerate(ends):
            dof = end.dof if isinstance(end, Pose) else end.shape[-1]
            columns = values.layout.unknowns(table.keys[:, place]).reshape(len(table), dof)
            for k, unit in enumerate(np.eye(dof) * STEP):
                sides = []
                for tangent in (unit, -unit):
                    moved = end.retract(np.tile(tangent, (len(table), 1))) if isinstance(end, Pose) else end + tangent
                    both = [moved if n == place else other for n, other in enumerate(ends)]
                    error = table.row.minus(table.values, table.predict_from(*both), table.dim)
                    sides.append((table.whitening @ error[..., None])[..., 0])
                slope = (sides[0] - sides[1]) / (2.0 * STEP)
                rows = np.arange(slope.size)
                whole = whole + sp.csc_array((slope.ravel(), (rows, np.repeat(columns[:, k], size))), shape=whole.shape)
        blocks.append(whole)
    return sp.csc_array(sp.vstack(blocks))[:, free]


def step(tables: Sequence[Table], values: Values, free: IntArray, damping: float = 0.0) -> tuple[Array, float]:
    """The step that lowers the cost, over all unknowns, and how far the optimum of the model is [sigmas]."""
    j, e = jacobian(tables, values, free), whitened(tables, values)
    hessian, gradient = sp.csc_array(j.T @ j), -(j.T @ e)
    delta = splu(sp.csc_matrix(hessian + damping * sp.diags_array(hessian.diagonal()))).solve(gradient)
    everywhere = np.zeros(values.layout.dof)
    everywhere[free] = delta
    return everywhere, float(np.sqrt(max(gradient @ delta, 0.0)))


@pytest.mark.parametrize(
    "name, cost, moved, tries", [("parking-garage.g2o", 1.23869, 0.01, 2), ("plaza2.pyfg", 1454.12, 1e-3, 2)]
)
def test_nothing_near_is_lower(data, name: str, cost: float, moved: float, tries: int) -> None:
    log = read(data(name))
    (component,) = full(log).components
    best, held = component.map.all_values, component.map.base
    free = np.setdiff1d(np.arange(best.layout.dof), best.layout.unknowns(np.array([held])))
    least = float(np.sum(whitened(log.tables, best) ** 2))
    assert component.map.cost == pytest.approx(cost, abs=0.006 if cost > 100.0 else 6e-6)
    assert least == pytest.approx(component.map.cost, rel=1e-8)
    _, far = step(log.tables, best, free)
    assert far < 1e-3
    rng = np.random.default_rng(0)
    for _ in range(tries):
        shift = np.zeros(best.layout.dof)
        shift[free] = rng.normal(0.0, moved, len(free))
        values, damping = best.retract(shift), 1e-9
        at = float(np.sum(whitened(log.tables, values) ** 2))
        assert at > 1.01 * least
        for _ in range(8):
            delta, _ = step(log.tables, values, free, damping)
            there = values.retract(delta)
            after = float(np.sum(whitened(log.tables, there) ** 2))
            if after < at:
                values, at, damping = there, after, 0.1 * damping
            else:
                damping *= 100.0
        assert least * (1.0 - 1e-6) < at < 1.01 * least
