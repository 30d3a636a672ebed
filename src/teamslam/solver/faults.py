"""A number that is not finite, by name: the variable or the measurement that brought it, and what to look at."""

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.model import Table, Values
from teamslam.solver.system import System


class Open(SolveError):
    """A search ended at `values`, where a variable is held by nothing."""

    def __init__(self, problem: SolveError, values: Values) -> None:
        super().__init__(str(problem), key=problem.key)
        self.values = values


def fault_at(system: System, values: Values) -> SolveError:
    """Why the cost of a system, its gradient or H is not finite at `values`: the error to raise."""
    if not np.isfinite(values.state).all():
        first = int(np.flatnonzero(~np.isfinite(values.state))[0])
        place = int(np.searchsorted(values.layout.state_start, first, side="right")) - 1
        name = system.names.describe(int(values.layout.keys[place]))
        return SolveError(f"the value of {name} is not finite; look at where its start comes from")
    for number, table in enumerate(system.tables):
        if (row := system.fault(number, values)) is not None:
            return SolveError(_of_row(system, table, row, values))
    for number, term in enumerate(system.submaps):
        if (member := system.fault_of_submap(number, values)) is not None:
            name = system.names.describe(int(term.values.layout.keys[member]))
            return SolveError(
                f"the submap in the frame of {system.names.describe(term.base)} and its estimate of {name} cost a "
                f"number that is not finite; look at the submap's information and at the start values"
            )
    return SolveError(
        "the costs of all measurements are finite, but their sum is not; look for information beyond 1e150 and for "
        "start values that are as far away"
    )


def fault_of_step(system: System, delta: Array) -> SolveError:
    """Which variable a step would carry beyond all numbers, though H is positive there: the error to raise."""
    place = int(np.searchsorted(system.free.dof_start, np.flatnonzero(~np.isfinite(delta))[0], side="right")) - 1
    name = system.names.describe(int(system.free.keys[place]))
    return SolveError(
        f"the step of {name} is not finite: what is measured of it spans more than double precision holds; look at the "
        f"units and the noise of its measurements"
    )


def _of_row(system: System, table: Table, row: int, values: Values) -> str:
    one = table.select(np.array([row]))
    ends = " and ".join(system.names.describe(int(key)) for key in one.keys[0])
    with np.errstate(all="ignore"):
        residual, whitened = one.residual(values)[0], one.whitened(values)[0]
    what = f"residual {residual}" if not np.isfinite(residual).all() else f"residual in sigmas {whitened}"
    if np.isfinite(whitened).all():
        what = "the derivative of its residual"
    return (
        f"{table.source}, row {int(one.ids[0])} of the log of robot {system.names.robot(table.robot)} ({table.model}, "
        f"between {ends}): {what} is not finite; look at the row, its noise, and the start values of the two"
    )
