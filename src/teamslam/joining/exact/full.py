"""The full nonlinear least squares over all raw measurements: the baseline that joining must equal.

It minimises F(G) = sum_i f_i over every measurement of every robot at once, starting from the joined submaps. Where a
submap has several local optima, the one that the team's cost is lowest with is taken (see `choose`).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from teamslam.errors import ModelError, SolveError
from teamslam.geometry import IntArray
from teamslam.joining.build.build import build_choices
from teamslam.joining.build.problem import ROUGH
from teamslam.joining.build.split import split
from teamslam.joining.exact.alone import excess_alone, excess_together
from teamslam.joining.exact.basins import lowest
from teamslam.joining.exact.instead import exact_or_joined
from teamslam.joining.join.account import Unbuilt, accounted
from teamslam.joining.join.gauge import anchor
from teamslam.joining.join.join import Component, Joined, join
from teamslam.joining.join.optimum import in_the_way, less
from teamslam.joining.start.adrift import adrift
from teamslam.joining.start.elsewhere import elsewhere, while_lower
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import A_LOG, WORLD, Dataset, Sources, Submap, Table, Values, expect, is_landmark
from teamslam.solver import Options, Solution, Step, System, reach
from teamslam.solver.optimise import DEFAULTS

NOBODY = np.zeros(0, np.int64)


def full(
    dataset: Dataset,
    *,
    initial: Joined | None = None,
    options: Options = DEFAULTS,
    progress: Callable[[Step], None] | None = None,
) -> Joined:
    """The optimum over all of a team's measurements, by components as `join` finds them.

    `initial`: a join to start from, and from nowhere else; by default the log is split, built and joined here. Each
    component's map is in the same frame as that of the join. What is in none of them is in `left_out`, a piece of which
    no submap can be built among it. Raises SolveError where none can, else as `join` does.
    """
    expect(dataset, Dataset, A_LOG)
    if initial is not None:
        return _from(dataset, initial, options, progress)
    rough = replace(options, max_iterations=min(options.max_iterations, ROUGH), decrement=max(options.decrement, 0.1))
    alternatives, unbuilt = [], []
    for piece in split(dataset):
        try:
            alternatives.append(build_choices(piece, options=options))
        except SolveError as error:
            unbuilt.append(Unbuilt(piece, str(error)))
    if not alternatives and unbuilt:
        raise SolveError(unbuilt[0].reason)

    def solve(submaps: Sequence[Submap]) -> Joined:
        built = {submap.id: submap for submap in submaps}
        return exact_or_joined(
            replace(join(submaps, options=rough), log=dataset),
            lambda c: _full(dataset, c, options, progress),
            lambda c: join([built[name] for name in c.members], near=Joined((c,)), options=options),
            dataset.tables,
        )

    found = lowest(
        alternatives,
        solve,
        partial(excess_alone, dataset.tables),
        partial(excess_together, dataset.tables),
    )
    return accounted(dataset, found, unbuilt)


def _from(dataset: Dataset, initial: Joined, options: Options, progress: Callable[[Step], None] | None) -> Joined:
    return exact_or_joined(
        replace(initial, log=dataset),
        lambda c: _full(dataset, c, options, progress),
        lambda c: Joined((c,)),
        dataset.tables,
    )


def _full(
    dataset: Dataset, component: Component, options: Options, progress: Callable[[Step], None] | None
) -> Component:
    joined = component.map
    if not joined.dof:
        return component
    start = joined.values if joined.base == WORLD else joined.all_values
    solution, tables, fixed = _lowest(dataset, joined, start, options, progress)
    keep = ~np.isin(solution.values.layout.keys, fixed)
    full_map = Submap(
        id="full:" + joined.id,
        version=joined.version,
        base=int(fixed[0]) if len(fixed) else WORLD,
        base_dim=joined.base_dim,
        values=solution.values.select(keep),
        information=lambda: solution.information,
        sources=Sources.of(tables),
        names=dataset.names,
        cost=solution.cost,
        chi2=solution.chi2,
        rows=solution.rows,
    )
    return Component(full_map, solution, component.members, dearer=component.dearer)


def _lowest(
    dataset: Dataset, joined: Submap, start: Values, options: Options, progress: Callable[[Step], None] | None
) -> tuple[Solution, list[Table], IntArray]:
    """As `_solved`, and from there again with landmarks put where what sees them costs less, while that gains."""
    return while_lower(
        _solved(dataset, joined, start, options, progress),
        lambda found: found[0],
        lambda found: elsewhere(found[0].values, found[1], found[2]),
        lambda other: _solved(dataset, joined, other, options, progress),
    )


def _solved(
    dataset: Dataset, joined: Submap, start: Values, options: Options, progress: Callable[[Step], None] | None
) -> tuple[Solution, list[Table], IntArray]:
    """The solution, the tables that it is of, and what is held. A landmark with which there is none is left out, unless
    there is one from the optimum of the rest."""
    world, loose = True, NOBODY
    without: tuple[Solution, list[Table], IntArray] | None = None  # the landmarks that were in the way
    while True:
        tables = [table for table in _within(dataset.tables, start) if world or not table.row.unary]
        if not tables:
            raise ModelError("none of the dataset's measurements speak of the map to start from")
        anchored, fixed, tables = _gauge(start, joined, tables)
        system = System(anchored.layout, tables=tables, fixed=fixed, names=dataset.names)
        try:
            found = reach(system, anchored, options, progress), tables, fixed
        except SolveError as error:
            if without is not None:
                return without
            if len(fixed) or joined.base == WORLD or is_landmark(error.key or 0):
                gone = in_the_way(start, error, NOBODY, tables)
                start, loose = less(start, gone), np.append(loose, gone)
            else:
                world = False  # free to turn in the world after all (see `anchor`)
            continue
        gone = adrift(found[0].values, tables, settled=found[0].converged)
        if without is not None:
            return found if found[0].converged and not len(gone) else without
        gone = np.setdiff1d(gone, loose)
        if len(gone):
            start, loose = less(start, gone), np.append(loose, gone)
            continue
        if not len(loose):
            return found
        without, start = found, _placed_again(found[0].values, dataset.tables, loose)
        if len(start) == len(anchored):
            return found


def _placed_again(values: Values, tables: Iterable[Table], loose: IntArray) -> Values:
    """An optimum with the landmarks put back that were in the way of it, where it holds them."""
    return triangulate(values, [t.select(np.isin(t.keys[:, -1], loose)) for t in tables if not t.row.unary])


def _within(tables: Iterable[Table], values: Values) -> Iterable[Table]:
    """The rows whose variables are all among the values."""
    for table in tables:
        there = table.told_by(values.layout)
        if there.any():
            yield table.select(there)


def _gauge(start: Values, joined: Submap, tables: list[Table]) -> tuple[Values, IntArray, list[Table]]:
    if joined.base == WORLD:
        return start, NOBODY, tables
    return anchor(start, joined, tables)
