"""Laws of what stands for an exact map where nothing leads to one: it is the join's own, says that it is no optimum of
all rows, and why; what is apart from it is exact all the same."""

from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining import Component, Joined, build, cost_of, exact_join, full, join, split
from teamslam.joining.exact.instead import exact_or_joined
from teamslam.solver import Status
from worlds import apart, team


def test_full_least_squares_of_rows_that_leave_a_robot_open_is_the_join_that_it_began_from() -> None:
    log = team("2d", robots=2)
    start = join([build(piece) for piece in split(log)])
    ties = [t for t in log.tables if t.source == "robots" or (t.robot == 2 and t.source == "landmarks")]
    fewer = log.with_tables(t for t in log.tables if t not in ties)
    found = full(fewer, initial=start)
    (component,) = found.components
    assert component.solution is not None and component.solution.status is Status.INEXACT
    assert not found.converged
    np.testing.assert_array_equal(component.map.values.state, start.map.values.state)
    assert component.map.cost == component.solution.cost == cost_of(start.map, fewer.tables).cost
    (remark,) = found.remarks
    assert remark.startswith("not exact: the map of 1/0 and 2/0 is that of the join") and "robot 2 at pose" in remark


def test_what_fails_of_one_component_costs_no_other_anything() -> None:
    log = apart()
    joined = join([build(piece) for piece in split(log)])
    exact = {component.members: component for component in exact_join(split(log)).components}

    def solve(component: Component) -> Component:
        if component.map.base == joined.map.base:
            raise SolveError("robot 2 at pose 0 is not determined")
        return exact[component.members]

    found = exact_or_joined(joined, solve, lambda component: Joined((component,)), log.tables)
    first, *others = found.components
    assert first.solution is not None and not first.solution.converged
    assert first.map.values is joined.map.values
    assert [c.map for c in others] == [c.map for c in list(exact.values())[1:]]
    assert found.reasons == joined.reasons
    assert len(found.remarks) == 1 and found.remarks[0].endswith("robot 2 at pose 0 is not determined")


def test_a_join_that_falls_apart_is_exact_part_by_part() -> None:
    log = apart()
    whole = join([build(piece) for piece in split(log)])
    one = replace(whole, components=whole.components[:1], reasons=())  # as if it had held all of them

    def solve(component: Component) -> Component:
        if component is one.components[0]:
            raise SolveError("no")
        return component

    again = replace(whole, components=tuple(replace(c) for c in whole.components))
    found = exact_or_joined(one, solve, lambda component: again, log.tables)
    assert [c.members for c in found.components] == [c.members for c in whole.components]
    assert found.reasons == whole.reasons and not found.remarks and found.converged
