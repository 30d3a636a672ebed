"""No map costs more than the optimum that the truth leads to, but by what it says itself: its gap, another way to put
it together, or a solve that stopped short.

The truth costs about as many squared sigmas as there are rows; a search that begins there ends in the basin that every
search is to end in, or in a lower one. That needs no dense matrix: it is asked of logs of any size.
"""

from collections.abc import Sequence

import numpy as np

from stress.drive import Outcome
from stress.failure import Findings
from stress.maps import cost_at, everything, rows_of
from stress.oracle import true_values
from teamslam.errors import SolveError
from teamslam.joining import Component
from teamslam.model import WORLD, Submap, Table, Values
from teamslam.solver import System, optimise

ABOVE = 1e-3  # of the cost, and of one sigma squared: so little above the optimum from the truth a map may end
FORGIVING = 1.0  # of cost: under losses that forgive each row may be in or out, and no data tell so little
GAP = 5.0  # gaps that a join states: a step tells the size of one, and losses that forgive change their weights
NAMED = 9.0  # of cost: so much more a second place that is named may cost, or less


def check_truth(outcome: Outcome, findings: Findings) -> None:
    """Every map of an outcome that has converged."""
    for component in outcome.components:
        gap = _gap(component, outcome)
        if gap is None or component.solution is None or not component.solution.converged:
            continue
        rows = list(rows_of(component.map, outcome.log))
        least = cost_from(true_values(outcome.log), component.map, rows)
        if least is None:
            continue
        values = everything(component.map)
        above = cost_at(rows, values) - least
        forgiving = any(t.loss.name not in ("squared", "huber") for t in rows)
        rounding = 10.0 * System(values.layout, tables=rows).rounding(values) * float(np.sqrt(least + 1.0))
        allowed = ABOVE * (least + 1.0) + rounding + FORGIVING * forgiving + GAP * gap
        allowed += NAMED * _is_named(component, outcome)
        findings.check(
            "no map costs more than the optimum from the truth",
            above <= allowed or bool(component.ambiguities),
            f"{least:.6g} from the truth, {above:.4g} more in the map, of which it states {allowed:.3g}",
        )


def cost_from(truth: Values, submap: Submap, rows: Sequence[Table]) -> float | None:
    """What a map's rows cost at the optimum that the truth leads to, with its base held where it truly is; None where
    the truth does not know all of its variables."""
    keys = submap.keys[submap.keys != WORLD]
    if not rows or not truth.layout.contains(keys).all():
        return None
    there = truth.only(keys)
    fixed = keys[keys == submap.base]
    system = System(there.layout, tables=list(rows), fixed=fixed)
    try:
        return optimise(system, there).cost
    except SolveError:  # no optimum: the truth's own cost is as much an upper bound
        return system.cost(there)


def _gap(component: Component, outcome: Outcome) -> float | None:
    """The decrease of cost that is still to be had, as stated; None where nothing is, as of joins whose pieces are not
    all there."""
    if component.exactness is not None:
        return component.exactness.gradient_norm**2
    return 0.0 if outcome.exact else None


def _is_named(component: Component, outcome: Outcome) -> bool:
    """Whether a remark names a second place of one of its landmarks."""
    assert outcome.joined is not None
    landmarks = {component.map.names.describe(int(key)) for key in component.map.keys}
    return any(
        remark.startswith("ambiguous: ") and any(f" {name} is at (" in remark for name in landmarks)
        for remark in outcome.joined.remarks
    )
