"""What is still to be gained at a point of the team's problem, though nobody holds all raw data.

    robot:        f_i, g_i = grad f_i, H_i = J'WJ of its raw measurements where it is
    coordinator:  F = sum f_i,   the Gauss-Newton step d of the whole F there,   g'd = |grad F|^2 in H^-1

g'd is the decrease of F that the step promises; against F it is the relative cost gap. At the full least squares it is
zero. What robots and coordinator would find between them is found here at once, by one linearisation of all of F and
one solve, since sums over robots are sums.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining.join.join import Exactness
from teamslam.model import Layout, Submap, Table, Values, is_parameter
from teamslam.solver import Factor, System
from teamslam.solver.linear import Matrix, in_sigmas


@dataclass(frozen=True, eq=False)
class Inverted:
    """The inverse of a matrix by its `factor`, with blocks that are found once for all who ask."""

    factor: Factor = field(repr=False)

    @cached_property
    def marginals(self) -> list[tuple[IntArray, Array]]:
        """The blocks of all variables (see `Factor.marginals_by_size`)."""
        return self.factor.marginals_by_size()


@dataclass(frozen=True, eq=False)
class Gap:
    """The team's problem, a `system`, at one point: `cost` F, `hessian` H and `step` d over the variables `free`, the
    `decrease` g'd of F that d promises, and the `factor` of H."""

    system: System
    free: Layout
    cost: float
    hessian: Matrix
    step: Array
    decrease: float
    factor: Factor

    @cached_property
    def covariance(self) -> Inverted:
        """That of all variables there."""
        return Inverted(self.factor)

    def farthest(self, shift: Array, layout: Layout) -> float:
        """The longest of some variables' shifts (dof,), each in its own standard deviations."""
        everywhere = np.zeros(self.free.dof)
        everywhere[self.free.unknowns(layout.keys)] = shift
        return float(in_sigmas(everywhere, self.free, self.covariance.marginals).max(initial=0.0))

    def exactness(self, *, join_shift_sigma: float = 0.0, rounds: int, bytes: int) -> Exactness:
        """The account of a map that ends here, after so many rounds and bytes."""
        return Exactness(
            relative_cost_gap=self.decrease / self.cost if self.cost > 0.0 else 0.0,
            gradient_norm=float(np.sqrt(self.decrease)),
            max_shift_sigma=self.farthest(self.step, self.free),
            join_shift_sigma=join_shift_sigma,
            rounds=rounds,
            bytes=bytes,
        )


def gap_at(values: Values, tables: Sequence[Table], joined: Submap) -> Gap:
    """The gap of all measurements at `values`, in the frame of `joined`.

    Raises SolveError where the problem is not determined there.
    """
    return _gap_of(_system_of(values, tables, joined), values)


def _system_of(values: Values, tables: Sequence[Table], joined: Submap) -> System:
    return System(values.layout, tables=tables, fixed=frame_of(joined), names=joined.names)


def _gap_of(system: System, values: Values) -> Gap:
    at = system.linearise(values)
    factor = system.factor(values)
    factor.factorise(at.hessian.numbers)
    step = factor.solve(at.gradient)
    decrease = max(float(at.gradient @ step), 0.0)
    return Gap(system, system.free, at.cost, at.hessian, step, decrease, factor)


class AtMap:
    """The rows of `tables` that are in a map, at its estimate `values`: linearised together once, when somebody first
    asks, for all who ask."""

    def __init__(self, tables: Sequence[Table], joined: Submap) -> None:
        self.joined, self.values = joined, point_of(joined)
        self.tables = rows_in(joined, tables)

    @cached_property
    def system(self) -> System:
        """The problem that these rows are."""
        return _system_of(self.values, self.tables, self.joined)

    @cached_property
    def gap(self) -> Gap:
        """The gap there. Raises SolveError where these rows do not determine the map."""
        return _gap_of(self.system, self.values)

    @property
    def renewed(self) -> Submap:
        """The map as these rows have it where it is: with their information, whatever it was made of. Raises SolveError
        where they do not determine it."""
        values = self.values.only(self.gap.free.keys)
        return replace(self.joined, values=values, information=self.gap.hessian.to_csr())

    def __len__(self) -> int:
        """How many rows are in the map."""
        return sum(map(len, self.tables))


def rows_in(joined: Submap, tables: Iterable[Table]) -> list[Table]:
    """The rows of `tables` that a map was made of (see `Submap.rows_of`), table by table; no table without any."""
    held = [(table, joined.rows_of(table)) for table in tables]
    return [table if mask.all() else table.select(mask) for table, mask in held if mask.any()]


def frame_of(joined: Submap) -> IntArray:
    """The variables that do not move: the base of a map, none where that is the world."""
    return np.array([b for b in (joined.base,) if b >= 0], np.int64)


def point_of(joined: Submap) -> Values:
    """Where a map is: the estimate of all its poses and landmarks, its base among them unless that is the world."""
    values = joined.all_values if joined.base >= 0 else joined.values
    parameters = is_parameter(values.layout.keys)
    return values.select(~parameters) if parameters.any() else values


def raw_cost(raw: Sequence[Table], values: Values) -> float:
    """What the raw measurements between robots cost."""
    return sum(t.cost(values) for t in raw)
