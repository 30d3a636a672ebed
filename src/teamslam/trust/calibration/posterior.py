"""The map and the systematic errors together, by the noise as it is taken to be: one step of weighted least squares.

    minimise  sum_i w_i |W_i (e_i - J_i d - D_i p)|^2 + |p / tau|^2

The map's step d is eliminated, H = sum w J'W'WJ; what is left for p is its Schur complement S, over which `chosen` may
choose. `Fit.left` says what is left of any errors, those measured or those drawn, all by one factor of H.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Values
from teamslam.model.sparse import sp
from teamslam.solver import Factor
from teamslam.trust.calibration.choice import Choice, chosen, posterior
from teamslam.trust.calibration.rows import Column, Effects, Linear


@dataclass(frozen=True, eq=False)
class Fit:
    """A linear estimator of the map and of the systematic errors of a `choice` (columns of `linear`), by `weight`,
    w W'W of all rows. `values` of those, with their joint `covariance`, in units of their first guesses; `effects` on
    all rows, and the `half` L^-1 J'W of these, for L L' = H."""

    linear: Linear
    weight: sp.csr_array
    factor: Factor
    pulled: "Pulled"
    choice: Choice
    covariance: Array
    values: Array
    effects: Effects
    half: Array

    @classmethod
    def of(
        cls,
        linear: Linear,
        roots: Sequence[Array],
        choice: Choice | None = None,
        differing: Sequence[sp.csr_array | None] = (),
    ) -> "Fit":
        """The estimator by `roots` w^1/2 W (m, r, r) of each table, and by how rows that follow each other differ, with
        the systematic errors of a `choice`; without one, every one that there may be is in, as its first guess lets it.
        Raises SolveError where the rows do not determine the map."""
        at, values = linear.at, linear.at.values
        choice = choice or Choice.all(len(linear.columns))
        weight = block_diagonal(linear, roots)
        if any(each is not None for each in differing):
            parts = zip(differing, linear.tables, strict=True)
            between = sp.block_diag(
                [sp.csr_array((0, len(t) * t.row.residual_rows(t.dim))) if d is None else d for d, t in parts], "csr"
            )
            weight = sp.csr_array(weight + between.T @ between)
            information = sp.csr_array(linear.jacobian.T @ (weight @ linear.jacobian))
            factor = Factor.of(at.gap.free, information, linear.names, values)
        else:
            factor = at.gap.system.factor(values)  # of one structure: analysed once
            for k, root in enumerate(roots):
                linear.system.set_whitening(k, root)
            factor.factorise(linear.system.linearise(values).hessian.numbers)
        return cls._with(linear, weight, factor, Pulled.of(linear, weight, factor, choice.inside), choice)

    @classmethod
    def _with(cls, linear: Linear, weight: sp.csr_array, factor: Factor, pulled: "Pulled", choice: Choice) -> "Fit":
        mine = np.searchsorted(pulled.which, choice.inside)
        if len(mine) < len(pulled.which):
            values, covariance = posterior(pulled.information[np.ix_(mine, mine)], pulled.slope[mine], choice.tau)
            effects, half = pulled.effects.only(mine), np.ascontiguousarray(pulled.half[:, mine])
        else:
            values, covariance = posterior(pulled.information, pulled.slope, choice.tau)
            effects, half = pulled.effects, pulled.half
        return cls(linear, weight, factor, pulled, choice, covariance, values, effects, half)

    def chosen(self) -> "Fit":
        """The same with those of its systematic errors that the data speak of."""
        linear, pulled = self.linear, self.pulled
        groups, relative = linear.groups[pulled.which], linear.relative[pulled.which]
        choice = chosen(pulled.information, pulled.slope, groups, relative)
        choice = Choice(pulled.which[choice.inside], choice.tau)
        return self._with(linear, self.weight, self.factor, pulled, choice)

    @property
    def inside(self) -> list[Column]:
        """The systematic errors that are in."""
        return [self.linear.columns[place] for place in self.choice.inside]

    @cached_property
    def followed(self) -> Array:
        """How the map has followed each of the systematic errors that are in (unknowns, k)."""
        return self.factor.draws(self.half)

    def moved(self) -> Values:
        """Where the map goes when systematic errors are taken out."""
        linear, errors = self.linear, self.linear.errors.copy()
        self.effects.along(self.values, errors)
        step = self.factor.solve(linear.jacobian.T @ (self.weight @ errors))
        return linear.at.gap.system.retract(linear.at.values, step)

    def left(self, errors: Array) -> Array:
        """What is left of errors (N, draws) of all rows when map and systematic errors have followed them."""
        pull = self.weight @ errors
        gradient = self.linear.jacobian.T @ pull
        if len(self.values):
            half = self.factor.half(gradient)
            values = self.covariance @ (self.effects.pull(pull) - self.half.T @ half)
            half -= self.half @ values
            step = self.factor.draws(half)
        else:
            step = self.factor.solve(gradient)
        left: Array = self.linear.jacobian @ step
        np.subtract(errors, left, out=left)
        if len(self.values):
            self.effects.along(values, left)
        return left


@dataclass(frozen=True, eq=False)
class Pulled:
    """What the rows say of some systematic errors, `which` of all that there may be, when the map is eliminated: their
    `effects` D, their `information` S and `slope` g, and the `half` L^-1 J'WD (unknowns, k)."""

    which: IntArray
    effects: Effects
    information: Array
    slope: Array
    half: Array

    @classmethod
    def of(cls, linear: Linear, weight: sp.csr_array, factor: Factor, which: IntArray) -> "Pulled":
        """By the weights w W'W of all rows, and the factor of H."""
        effects = linear.effects if len(which) == len(linear.columns) else linear.effects.only(which)
        if not len(which):
            return cls(which, effects, np.zeros((0, 0)), np.zeros(0), np.zeros((linear.jacobian.shape[1], 0)))
        cross, information = crossed(linear, weight, effects)
        half = factor.half(cross)
        information -= half.T @ half
        pull = weight @ linear.errors
        slope = effects.pull(pull) - half.T @ factor.half(linear.jacobian.T @ pull)
        return cls(which, effects, 0.5 * (information + information.T), slope, half)


def block_diagonal(linear: Linear, roots: Sequence[Array]) -> sp.csr_array:
    """The weights w W'W (N, N) of all rows, by `roots` w^1/2 W (m, r, r) of each table."""
    squares = [(np.swapaxes(root, 1, 2) @ root).ravel() for root in roots]
    size = len(linear.errors)
    return sp.csr_array((np.concatenate([*squares, np.zeros(0)]), *linear.blocks), shape=(size, size))


def crossed(linear: Linear, weight: sp.csr_array, effects: Effects) -> tuple[Array, Array]:
    """J'W D (unknowns, k) and D'W D (k, k) of effects D, by the weights of all rows."""
    cross, own = np.zeros((linear.jacobian.shape[1], effects.count)), np.zeros((effects.count, effects.count))
    weighed = linear.by_tables(weight @ _side_by_side(effects))
    for places, mine, jacobian, rows in zip(effects.places, effects.own, linear.jacobians, weighed, strict=True):
        if len(places):
            pulls = np.ascontiguousarray(rows.reshape(len(mine), -1)[:, : len(places)])
            cross[:, places] = jacobian.T @ pulls
            own[np.ix_(places, places)] = mine.T @ pulls
    return cross, own


def _side_by_side(effects: Effects) -> Array:
    """What systematic errors do to the rows of their tables (N, most of one table)."""
    out = np.zeros((sum(map(len, effects.own)), max(map(len, effects.places), default=0)))
    first = 0
    for own in effects.own:
        out[first : first + len(own), : own.shape[1]] = own
        first += len(own)
    return out
