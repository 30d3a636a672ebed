"""What a run reports in numbers: costs, exactness, the verdict on the fit, and what is written of it."""

import json
from math import isclose

import numpy as np

from stress.drive import Outcome
from stress.failure import Findings
from stress.maps import cost_at, everything, least_of, rounding, rows_of, step_from
from stress.oracle import DENSE
from teamslam.joining import Component
from teamslam.model import Table, Values
from teamslam.results.folder import known
from teamslam.results.report import report_of
from teamslam.solver import System, optimise

SMALL = 0.3  # [sigmas]: so near the optimum the decrease that a step promises is what there is to gain
FITS = 3.0  # of a number measured: what a map that fits costs at most
CUT = 1e-3  # [rad] from half a turn: there a rotation's residual jumps, and differences say nothing
DIFFERENCES = 1e-8  # of residuals: a gradient by differences is good to that
LEVELS = ("fits", "loose", "strained", "misfit", "unknown")


def check_reports(outcome: Outcome, findings: Findings, *, fair: bool) -> None:
    """The figures beside a map; `fair`: noise is what it is stated to be."""
    for component in outcome.components:
        if component.exactness is not None:
            _exactness(component, list(rows_of(component.map, outcome.log)), findings)
    if outcome.result is None:
        return
    for component, cost in zip(outcome.components, outcome.result.costs, strict=True):
        if cost is not None:
            rows, values = list(rows_of(component.map, outcome.log)), everything(component.map)
            mine = cost_at(rows, values)
            near = isclose(mine, cost.cost, rel_tol=1e-6, abs_tol=1e-6 + rounding(rows, values, mine))
            findings.check("a report's cost is that of the rows", near, f"stated {cost.cost:.9g}, found {mine:.9g}")
    report = report_of(outcome.result)
    findings.check("a report is JSON", _is_json(known(report)))
    fit = report["fit"]
    findings.check("the verdict is one of five", fit["verdict"] in LEVELS, fit["verdict"])
    if fair:
        findings.check("honest noise is no misfit", not fit["gross"], fit["sentence"])
        findings.check("an innocent log is accused of nothing", not fit["causes"], fit["causes"])


def _is_json(report: object) -> bool:
    try:
        return bool(json.dumps(report, allow_nan=False))
    except ValueError:
        return False


def half_turned(table: Table, values: Values) -> bool:
    """Whether some row has a rotation the other way round from what it measured."""
    if table.model not in ("relative_pose", "pose"):
        return False
    off = table.row.minus(table.values, table.predict(values), table.dim)[:, table.dim :]
    return bool((np.linalg.norm(off, axis=-1) > np.pi - CUT).any())


def _exactness(component: Component, rows: list[Table], findings: Findings) -> None:
    """It is what a step from the map promises; and where that is little, what there is to gain."""
    submap, stated = component.map, component.exactness
    values = everything(submap)
    assert stated is not None
    if not 0 < submap.dof <= DENSE or any(half_turned(table, values) for table in rows):
        return
    cost, ahead = cost_at(rows, values), step_from(submap, rows)
    # Differences of residuals, and how these round beside the coordinates, hide the rest.
    hidden = 1e-7 * np.sqrt(cost) + 1e-4 + 10.0 * System(values.layout, tables=rows).rounding(values)
    hidden += DIFFERENCES * np.sqrt(cost + 1.0) / np.sqrt(max(least_of(submap), 1e-16))
    findings.check(
        "exactness is what a step promises",
        abs(stated.gradient_norm - ahead) <= 1e-2 * ahead + hidden,
        f"stated {stated.gradient_norm:.4g} sigmas, found {ahead:.4g}",
    )
    losses = {t.loss.name for t in rows}
    fits = cost < FITS * sum(t.dof for t in rows)  # else residuals bend the cost as much as the Jacobian does
    if not (1e-3 < stated.gradient_norm < SMALL and fits and losses <= {"squared", "huber"}):
        return
    held = System(values.layout, tables=rows, fixed=[submap.base] if submap.base >= 0 else [])
    best = optimise(held, values)
    gap, promised = cost - best.cost, stated.gradient_norm**2
    if best.converged:
        # The step knows the weights of a loss and not how they change: its gap is of the size of the true one.
        low, high = (0.7, 1.4) if losses == {"squared"} else (0.2, 5.0)
        unseen = 1e-9 * cost + rounding(rows, values, cost)
        near = low * promised - unseen <= gap <= high * promised + unseen
        findings.check("a stated gap is the true gap", near, f"stated {promised:.4g}, true {gap:.4g}")
