"""The join's own map where nothing leads from it to an optimum of all rows, and what is said of it then.

A join's map is a start of what is exact, and no start ends a run. So the join is solved to its end, and stands for what
was asked for: its status says so, and a remark says why. Where a join that is solved to its end falls apart, each part
of it is a start of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from teamslam.errors import SolveError
from teamslam.joining.exact.cost import cost_of
from teamslam.joining.join.join import Component, Joined
from teamslam.model import Table
from teamslam.solver import Status


def exact_or_joined(
    joined: Joined,
    exact: Callable[[Component], Component],
    again: Callable[[Component], Joined],
    tables: Sequence[Table],
) -> Joined:
    """What `exact` makes of each component; of one with which that fails, the join that is made `again`, with what the
    rows of `tables` cost there."""
    found: list[Component] = []
    reasons: list[str] = []
    remarks: list[str] = []
    for reason, component in zip(("", *joined.reasons), joined.components, strict=True):
        try:
            parts = Joined((exact(component),))
        except SolveError as error:
            parts = again(component)
            if len(parts.components) > 1:
                parts = exact_or_joined(parts, exact, again, tables)
            else:
                parts = Joined((_as_joined(parts.components[0], tables),), remarks=(_why(component, error),))
        found += parts.components
        reasons += [reason, *parts.reasons]
        remarks += parts.remarks
    return Joined(tuple(found), tuple(reasons[1:]), remarks=tuple(remarks), log=joined.log, searched=joined.searched)


def _as_joined(component: Component, tables: Sequence[Table]) -> Component:
    """A join's component that says that it is one, at what its rows cost; a submap alone is as it was built."""
    if component.solution is None:
        return component
    cost = cost_of(component.map, tables).cost
    solution = replace(component.solution, cost=cost, status=Status.INEXACT)
    return replace(component, map=replace(component.map, cost=cost), solution=solution)


def _why(component: Component, error: SolveError) -> str:
    which = " and ".join(sorted(component.members))
    return (
        f"not exact: the map of {which} is that of the join of its submaps, for from there no optimum of all rows was "
        f"found: {error}"
    )
