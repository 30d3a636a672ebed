"""What every map must be: finite, sure of itself by as much as its own rows allow, whole, and at an optimum."""

from collections.abc import Iterable, Sequence

import numpy as np

from stress.drive import Outcome
from stress.failure import Findings
from stress.oracle import DENSE, centred, jacobian, true_values, whitened
from stress.places import is_told
from teamslam.geometry import Array
from teamslam.joining import Component
from teamslam.model import WORLD, Dataset, Submap, Table, Values
from teamslam.solver import Covariances, Solution, Status, System, optimise

ROUNDING = 1e-6
FARTHER = 1e-2  # [sigmas]: so near its optimum a map must be that says it has converged
WORSE = 1e-3  # of the cost, and of one sigma squared: so little above the optimum from the truth a map may end
APART = 1.0  # [sigmas squared]: two optima that are farther from each other are two
LOOSE = 0.2  # [m], [rad]: an unknown held less well is not told by its ellipse alone
RULED_OUT = 9.0  # of cost: three sigmas; an optimum that costs more need not be named
SIGMAS = 6.0  # what a chi-square may be off, in its own standard deviations


def check_maps(outcome: Outcome, findings: Findings, *, fair: bool) -> None:
    """Every map of an outcome. `fair`: noise is what it is stated to be and small, so that there is one optimum."""
    for component in outcome.components:
        if not _sound(component.map, findings):
            continue
        rows = list(rows_of(component.map, outcome.log))
        _covariances(component, findings)
        if outcome.exact:
            _cost(component.map, rows, findings)
        if component.map.dof > DENSE:
            continue
        if outcome.exact and not _is_joined(component):
            _information(component.map, rows, findings)
            _optimum(component, rows, findings)
        if fair:
            _against_truth(component, rows, outcome, findings)


def _is_joined(component: Component) -> bool:
    """Whether it says that it is a join's map, where one was asked for that is exact."""
    return component.solution is not None and component.solution.status is Status.INEXACT


def rows_of(submap: Submap, log: Dataset) -> Iterable[Table]:
    """The rows of the log that a map says it holds, and whose variables it has, but for those that still wait: what was
    measured in the world among them only where the map is in the world's frame (see `account` for whether it should
    be)."""
    for table in log.tables:
        keep = np.zeros(len(table), bool)
        if table.row.unary and submap.base != WORLD:
            continue
        for stretch in submap.sources:
            if (stretch.robot, stretch.source) == (table.robot, table.source):
                keep |= (table.ids >= stretch.start) & (table.ids < stretch.stop)
        waiting = [t.ids for t in submap.raw if (t.robot, t.source) == (table.robot, table.source)]
        keep &= np.isin(table.keys, submap.keys).all(1) & ~np.isin(table.ids, np.concatenate([[], *waiting]))
        if keep.any():
            yield table.select(keep)


def everything(submap: Submap) -> Values:
    """The estimate with its base."""
    return submap.values if submap.base == WORLD else submap.all_values


def cost_at(rows: Iterable[Table], values: Values) -> float:
    """F: the losses of all rows."""
    return sum(float(t.loss.cost(np.sum(t.whitened(values) ** 2, -1)).sum()) for t in rows)


def weighted(rows: Iterable[Table], values: Values) -> tuple[Array, Array]:
    """The whitened residuals (m,) and Jacobian (m, dof), each by the root of its loss's weight."""
    rows = list(rows)
    residuals = [t.whitened(values) for t in rows]
    roots = [np.sqrt(t.loss.weight(np.sum(e**2, -1)))[:, None] for t, e in zip(rows, residuals, strict=True)]
    e = np.concatenate([(e * w).ravel() for e, w in zip(residuals, roots, strict=True)])
    every = np.concatenate([np.broadcast_to(w, e.shape).ravel() for e, w in zip(residuals, roots, strict=True)])
    return e, whitened(rows, jacobian(*centred(rows, values))) * every[:, None]


def free_of(submap: Submap, values: Values) -> Array:
    """The unknowns of a map among those of its values with the base."""
    return values.layout.unknowns(submap.values.layout.keys)


def step_from(submap: Submap, rows: list[Table]) -> float:
    """How far [sigmas] the Gauss-Newton step of the rows' cost goes from a map: |g| in the norm of H^-1."""
    values = everything(submap)
    e, j = weighted(rows, values)
    j = j[:, free_of(submap, values)]
    if not j.shape[1]:
        return 0.0
    scale = np.linalg.norm(j, axis=0)
    scale[scale == 0.0] = 1.0
    step, *_ = np.linalg.lstsq(j / scale, -e, rcond=1e-10)
    return float(np.linalg.norm(j / scale @ step))


# --- checks -------------------------------------------------------------------------------------------------------


def _sound(submap: Submap, findings: Findings) -> bool:
    """Numbers are finite, rotations are rotations, the information is symmetric and positive definite."""
    finite = np.isfinite(submap.values.state).all() and np.isfinite(submap.information.data).all()
    if not findings.check("a map's numbers are finite", bool(finite and np.isfinite(submap.cost)), submap.id):
        return False
    for kind, _, data in submap.values.parts():
        if kind.is_pose:
            gram = np.swapaxes(data.rotation, -1, -2) @ data.rotation - np.eye(kind.dim)
            findings.check("rotations are rotations", bool(np.abs(gram).max() < 1e-8), np.abs(gram).max())
    if not 0 < submap.dof <= DENSE:
        return True
    matrix = submap.information.toarray()
    diagonal = np.diag(matrix)
    if not findings.check("information is positive definite", bool((diagonal > 0.0).all()), diagonal.min()):
        return False
    scaled = matrix / np.sqrt(diagonal[:, None] * diagonal)
    lopsided = float(np.abs(scaled - scaled.T).max())
    findings.check("information is symmetric", lopsided < 1e-9, lopsided)
    least = float(np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0])
    findings.check("information is positive definite", least > -1e-12, f"least eigenvalue, scaled: {least}")
    return True


def least_of(submap: Submap) -> float:
    """The least eigenvalue of a map's information, each unknown in its own sigma were it alone: along there a gradient
    that is known to so many digits tells of as many fewer steps."""
    matrix = submap.information.toarray()
    scale = np.sqrt(np.diag(matrix))
    return float(np.linalg.eigvalsh(matrix / (scale[:, None] * scale))[0])


def _covariances(component: Component, findings: Findings) -> None:
    """They exist for all variables, finite and positive."""
    submap = component.map
    try:
        found = Covariances.of_map(submap)
        blocks = [found.of(int(key)) for key in submap.values.layout.keys]
    except Exception as error:
        findings.check("covariances of a map exist", False, f"{type(error).__name__}: {error}")
        return
    good = all(np.isfinite(b).all() and (np.diag(b) > 0.0).all() for b in blocks)
    findings.check("covariances of a map exist", good, "not finite, or not positive")


def _information(submap: Submap, rows: list[Table], findings: Findings) -> None:
    """It is that of its rows at the estimate: J'W'wWJ."""
    values = everything(submap)
    _, j = weighted(rows, values)
    j = j[:, free_of(submap, values)]
    mine, theirs = j.T @ j, submap.information.toarray()
    scale = np.sqrt(np.diag(mine))
    scale[scale == 0.0] = 1.0
    off = float(np.abs((mine - theirs) / (scale[:, None] * scale)).max(initial=0.0))
    findings.check("information is that of the rows", off < 1e-4, f"off by {off:.3g} of the diagonal")


def _cost(submap: Submap, rows: list[Table], findings: Findings) -> None:
    """A map's cost is that of its rows."""
    mine = cost_at(rows, everything(submap))
    near = abs(mine - submap.cost) <= 1e-6 * abs(mine) + 1e-6 + rounding(rows, everything(submap), mine)
    findings.check("cost is that of the rows", near, f"stated {submap.cost:.9g}, found {mine:.9g}")


def rounding(rows: list[Table], values: Values, cost: float) -> float:
    """Of a cost: each residual rounds by as much as the coordinates beside its sigma do, here and there in another
    way."""
    return float(10.0 * System(values.layout, tables=rows).rounding(values) * np.sqrt(cost + 1.0))


def _optimum(component: Component, rows: list[Table], findings: Findings) -> None:
    """Where it says it has converged, the gradient is zero, in sigmas."""
    if component.solution is None or not component.solution.converged:
        return
    ahead = step_from(component.map, rows)
    # Differences of residuals are good to 1e-9 of the Jacobian; on large residuals that is what is seen of a gradient.
    hidden = 1e-7 * float(np.sqrt(cost_at(rows, everything(component.map))))
    findings.check("a converged map is at an optimum", ahead < FARTHER + hidden, f"{ahead:.3g} sigmas from it")


def _against_truth(component: Component, rows: list[Table], outcome: Outcome, findings: Findings) -> None:
    """With noise as stated, and little of it: no worse than the optimum that the truth leads to, and near the truth."""
    submap, truth = component.map, true_values(outcome.log)
    keys = submap.keys[submap.keys != WORLD]
    if not submap.values.layout.dof or not truth.layout.contains(keys).all():
        return
    truth = truth.only(keys)
    if submap.base != WORLD:
        truth = truth.transform(truth.pose(submap.base).inverse())
    fixed = [] if submap.base == WORLD else [submap.base]
    system = System(truth.layout, tables=rows, fixed=np.array(fixed, np.int64))
    best = optimise(system, truth)
    away = best.values.only(submap.values.layout.keys).minus(submap.values)
    apart = float(away @ (submap.information @ away)) > APART
    if not best.converged or not _firm(best):
        return
    if outcome.exact and apart:
        above = submap.cost - best.cost
        costs = f"{submap.cost:.6g} and {best.cost:.6g}"
        lowest = above <= WORSE * (best.cost + 1.0)
        good = not lowest or above < -RULED_OUT or bool(component.ambiguities)
        assert outcome.joined is not None
        told = good or is_told(best, submap, system, outcome.joined.remarks)
        findings.check("another optimum that fits as well is named", told, costs)
        return
    if apart:
        return
    error = truth.only(submap.values.layout.keys).minus(submap.values)
    # Of a row that stands n times one noise counts n times: errors are up to n times as large, squared.
    nees, dof = float(error @ (submap.information @ error)) / _times(rows), submap.dof
    findings.check(
        "a map's errors are those that it expects",
        nees < dof + SIGMAS * np.sqrt(2.0 * dof) + 20.0,
        f"NEES {nees:.4g} of {dof} unknowns",
    )


def _firm(best: Solution) -> bool:
    """Whether every variable is held so well that errors are small beside what bends."""
    values = best.values
    covariance = np.linalg.pinv(best.information.toarray(), hermitian=True)
    return bool(np.sqrt(np.diag(covariance)).max(initial=0.0) < LOOSE and len(values))


def _times(rows: Sequence[Table]) -> int:
    """How often the row stands that stands most often."""
    most = 1
    for table in rows:
        alike = np.concatenate([table.keys, table.values], 1)
        most = max(most, int(np.unique(alike, axis=0, return_counts=True)[1].max(initial=1)))
    return most
