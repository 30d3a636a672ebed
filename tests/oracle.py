"""An independent oracle for the kernel and the solver: NumPy and SciPy, no analytic derivative, no own factorisation.

Residuals come from the laws in MODELS, Jacobians from differences, algebra from dense NumPy.
"""

import numpy as np
from scipy.optimize import least_squares

from teamslam.geometry import Array, Pose
from teamslam.model import Table, Values
from teamslam.solver import SubmapTerm, System

STEP = 1e-6


def residuals(tables: list[Table], submaps: list[SubmapTerm], values: Values) -> list[tuple[Array, Array]]:
    """Per table and submap: its residual vector (whitened for tables) and the matrix that weighs it."""
    out = []
    for table in tables:
        whitened = table.whitened(values)
        weights = table.loss.weight(np.sum(whitened**2, -1))
        out.append((whitened.ravel(), np.diag(np.repeat(weights, whitened.shape[1]))))
    for term in submaps:
        out.append((submap_residual(term, values), term.information.toarray()))
    return out


def submap_residual(term: SubmapTerm, values: Values) -> Array:
    """S^ (-) h(G) (paper, eqs. 12-14): the map's variables written in the submap's frame."""
    out = []
    for kind, keys, mine in term.values.parts():
        base = values.pose(term.base).lift(kind.dim) if values.layout.contains(term.base) else Pose.identity(kind.dim)
        if isinstance(mine, Pose):
            out.append(mine.minus(base.between(values.poses_of(keys, kind.dim))).ravel())
        else:
            out.append((mine - base.unact(values.positions(keys, kind.dim))).ravel())
    return np.concatenate(out)


def cost(tables: list[Table], submaps: list[SubmapTerm], values: Values) -> float:
    """F: robust losses of tables, quadratic forms of submaps."""
    total = sum(float(t.loss.cost(np.sum(t.whitened(values) ** 2, -1)).sum()) for t in tables)
    for term in submaps:
        e = submap_residual(term, values)
        total += float(e @ (term.information @ e))
        total += 2.0 * float(term.slope @ e) if term.slope is not None else 0.0
    return total


def normal_equations(
    tables: list[Table], submaps: list[SubmapTerm], values: Values, free: Array
) -> tuple[Array, Array]:
    """H and g over the `free` unknowns, dense, by central differences."""
    n = values.layout.dof
    jacobians: list[list[Array]] = [[] for _ in range(len(tables) + len(submaps))]
    for unknown in range(n):
        step = np.zeros(n)
        step[unknown] = STEP
        ahead, behind = (residuals(tables, submaps, values.retract(s)) for s in (step, -step))
        for column, (a, _), (b, _) in zip(jacobians, ahead, behind, strict=True):
            column.append((b - a) / (2.0 * STEP))
    h, g = np.zeros((n, n)), np.zeros(n)
    at = residuals(tables, submaps, values)
    for number, ((e, weight), columns) in enumerate(zip(at, jacobians, strict=True)):
        j = np.stack(columns, -1)
        slope = submaps[number - len(tables)].slope if number >= len(tables) else None
        h += j.T @ weight @ j
        g += j.T @ (weight @ e + (slope if slope is not None else 0.0))
    return h[np.ix_(free, free)], g[free]


def scipy_optimum(system: System, start: Values) -> tuple[float, Values]:
    """The least cost that SciPy's trust region finds from `start`, and where: over residuals of which each row is
    shortened so that its square is what it costs under its loss."""

    def shortened(delta: Array) -> Array:
        values = system.retract(start, delta)
        rows = []
        for table in system.tables:
            whitened = table.whitened(values)
            squared = np.maximum(np.sum(whitened**2, -1), 1e-300)
            rows.append((whitened * np.sqrt(table.loss.cost(squared) / squared)[:, None]).ravel())
        return np.concatenate(rows)

    found = least_squares(shortened, np.zeros(system.free.dof), xtol=1e-15, ftol=1e-15, gtol=1e-13, x_scale="jac")
    return 2.0 * float(found.cost), system.retract(start, found.x)
