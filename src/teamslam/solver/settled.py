"""An estimate nearer to the optimum of some rows, for those who are still on the way to a start."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray
from teamslam.model import Table, Values
from teamslam.solver.optimise import Options, optimise
from teamslam.solver.reach import convex_start, firm
from teamslam.solver.system import System

STEPS = 20  # at most


def settled(values: Values, tables: Sequence[Table], base: IntArray) -> Values:
    """`values` after a few steps of least squares of those rows whose variables they all have, with the variables
    `base` held; first with losses that do not forgive, where that leads lower (see `convex_start`), since what closes a
    loop may be out of sight of others. What no row names stays where it was, and so does everything where nothing is
    found."""
    ready = [t.select(np.asarray(values.layout.contains(t.keys).all(1))) for t in tables]
    used = values.only(np.unique(np.concatenate([base, *(t.keys.ravel() for t in ready)])))
    system = System(used.layout, tables=[t for t in ready if len(t)], fixed=base)
    few = Options(max_iterations=STEPS, decrement=0.1 * float(np.sqrt(system.free.dof + 1.0)))
    with suppress(SolveError):  # a guess stays a guess
        return values.update(firm(system, optimise(system, convex_start(system, used, few), few)).values)
    return values
