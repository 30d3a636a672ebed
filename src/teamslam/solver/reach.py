"""Starts again, where one fails: a search that ends short of an optimum, or in one that makes no sense, goes on from
elsewhere.

    off kinks   where rows came to a kink (see `kinks`), without them for a while, and with them again
    convex      where losses forgive, from the optimum under a loss that does not
    sharpened   where some measure far sharper than others, from optima under which they do not yet (see `sharpening`)

A start is a guess. Where it leads to an optimum that makes sense, that is all there is to do. Where rows contradict
each other no optimum makes sense, and better ones are looked for in vain: so each start is tried once, and one that
leads back to what was found is the last.

Bound: AGAIN + 2 solves, and rough ones of a few iterations that make their starts: one for each time off kinks, one for
convex, and of sharpened one for each factor of ten between sigmas. None where `Options.elsewhere` is off.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.model import SQUARED, Values, is_landmark
from teamslam.solver.faults import Open
from teamslam.solver.kinks import at_kink
from teamslam.solver.linear import Factor
from teamslam.solver.optimise import DEFAULTS, Options, optimise
from teamslam.solver.rank import fixes
from teamslam.solver.sharpening import sharpened_start
from teamslam.solver.solution import SAME, Solution, Step
from teamslam.solver.system import System

FEW = 30  # iterations without the rows at a kink
ROUNDING = 0.5**53  # of the diagonal of H: each of its numbers is known no better
AGAIN = 3  # times, at most, that rows come to a kink
PATIENCE = 100  # iterations under a loss that does not forgive, which a start is worth
THERE = 1.0  # [sigmas] from an optimum: a start that is there already


def reach(
    system: System,
    start: Values,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
    factor: Factor | None = None,
) -> Solution:
    """`optimise`, from `start` and, where that ends short of an optimum or in one that makes no sense, from elsewhere;
    of what is found the lowest optimum, the lowest of all where there is none. Raises SolveError where nothing leads to
    where all variables are held: as `optimise` does, and where its search has no factor at its end, which no map can be
    made of."""
    found: Solution | None = None
    problem: SolveError | None = None
    try:
        found = firm(system, optimise(system, start, options, progress, factor))
        if _makes_sense(found):
            return found
        ended = found.values
    except Open as error:
        problem, ended = error, error.values
    for other in _others(system, start, ended, options) if options.elsewhere else ():
        try:
            another = firm(system, optimise(system, other, options, progress, factor))
        except SolveError:
            continue
        if found is not None and same_optimum(found, another):
            break
        found = another if found is None else min(found, another, key=lambda s: (not s.converged, s.cost))
        if _makes_sense(found):
            break
    if found is None:
        assert problem is not None
        raise _in_true_words(system, start, ended, problem)
    return found


def _makes_sense(solution: Solution) -> bool:
    return solution.converged and not solution.senseless


def same_optimum(one: Solution, other: Solution) -> bool:
    """Whether two searches ended in optima that cost the same to rounding, which are taken for one."""
    return one.converged and other.converged and abs(one.cost - other.cost) <= SAME * (1.0 + one.cost)


def firm(system: System, solution: Solution) -> Solution:
    """The same solution, for those who need its information or stand on where it is. Raises Open, naming a variable,
    where it is short of an optimum and its information has no factor, or one by rounding alone."""
    if not solution.converged:
        try:
            refuse_rounding(system, solution)
        except SolveError as problem:
            raise Open(problem, solution.values) from None
    return solution


def _in_true_words(system: System, start: Values, ended: Values, problem: SolveError) -> SolveError:
    """Why a search ended where a variable is held by nothing: the rows leave it open, or where it went is to blame. A
    landmark that the search put on its sensor is named first: what hangs on that is open as well."""
    if problem.key is None:
        return problem
    sensor = None if is_landmark(problem.key) else _on_a_sensor(system, start, ended)
    key = problem.key if sensor is None else sensor
    name = system.names.describe(key)
    if fixes(system, start):
        squared = any(table.loss == SQUARED and table.source != "odometry" for table in system.tables)
        pulled = "; a loss that forgives (`--loss huber`) lets rows that are far off pull less" if squared else ""
        where = "short of one" if sensor is None else "with it on top of a sensor that sees it"
        return SolveError(
            f"{name} is fixed by the measurements, but the search for an optimum ended {where}, where next to nothing "
            f"is left that holds it; look for rows that contradict each other, or whose sigmas are very far apart"
            f"{pulled}",
            key=key,
        )
    why = (
        "look for what observes it, which may be too little (`teamslam info` looks for such)"
        if sensor is None
        else "they are met best with it on top of a sensor that sees it, where they say nothing of where it is"
    )
    return SolveError(f"{name} is not determined by the measurements: {why}", key=key)


def _on_a_sensor(system: System, start: Values, ended: Values) -> int | None:
    """A landmark that a search put on its sensor."""
    for table in system.tables:
        for key in table.keys[at_kink(table, start, ended), -1].tolist():
            if is_landmark(key):
                return int(key)
    return None


def _others(system: System, start: Values, ended: Values, options: Options) -> Iterator[Values]:
    for _ in range(AGAIN):
        off = _off_kinks(system, start, ended, options)
        if off is None:
            break
        ended = off
        yield off
    convex = convex_start(system, start, options)
    if convex is not start:
        yield convex
    sharpened = sharpened_start(system, start, options)
    if sharpened is not None:
        yield sharpened


def _off_kinks(system: System, start: Values, ended: Values, options: Options) -> Values | None:
    """Where a search goes from its end without the rows that came to a kink since its start; None where there are none,
    or nothing is found."""
    native = {n: t for n, t in enumerate(system.tables) if t.row.native and len(t)}
    masks = {n: at_kink(t, start, ended) for n, t in native.items()}
    masks = {n: mask for n, mask in masks.items() if mask.any()}
    if not masks:
        return None
    try:
        for n, mask in masks.items():
            system.set_weights(n, np.where(mask, 0.0, 1.0))
        rough = replace(options, max_iterations=min(options.max_iterations, FEW), decrement=max(options.decrement, 0.1))
        return optimise(system, start, rough).values
    except SolveError:
        return None
    finally:
        for n in masks:
            system.set_weights(n, None)


def refuse_rounding(system: System, solution: Solution) -> None:
    """Raise SolveError, naming the variable, where the information at an estimate is positive by rounding alone: it is
    so no more once each number of its diagonal is off by its own rounding."""
    if not system.free.dof:
        return
    information = solution.hessian
    system.factor(solution.values).factorise(information.numbers, -ROUNDING * information.diagonal())


def convex_start(system: System, start: Values, options: Options = DEFAULTS) -> Values:
    """A better start where losses forgive far outliers: under those, a start may lie beyond what they still see.

    Huber's loss of the same scale has one basin for each row; it is solved first, roughly. Where no loss forgives, or
    where that leads to nothing better (onto the sensor, say, where a landmark may have any bearing), or to where it
    began, `start`.
    """
    convex = system.convex()
    if convex is system:
        return start
    rough = replace(
        options, max_iterations=min(options.max_iterations, PATIENCE), decrement=max(options.decrement, 0.1)
    )
    try:
        found = optimise(convex, start, rough)
    except SolveError:
        return start
    moved = found.history[0].decrement > THERE if found.history else False
    return found.values if moved and system.cost(found.values) < system.cost(start) else start
