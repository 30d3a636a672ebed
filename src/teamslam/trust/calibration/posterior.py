"""The map and the systematic errors together, by the noise as it is taken to be: one step of weighted least squares.

    minimise  sum_i w_i |W_i (e_i - J_i d - D_i p)|^2 + |p / tau|^2

The map's step d is eliminated, H = sum w J'W'WJ; what is left for p is its Schur complement S, over which `chosen` may
choose. `Fit.left` says what is left of any errors, those measured or those drawn, all by one factor of H.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Values
from teamslam.model.losses import SQUARED
from teamslam.model.sparse import sp
from teamslam.solver import Factor, System
from teamslam.trust.calibration.choice import Choice, chosen, posterior
from teamslam.trust.calibration.rows import Column, Linear, held_at


@dataclass(frozen=True, eq=False)
class Fit:
    """A linear estimator of the map and of the systematic errors of a `choice` (columns of `linear`), by `weight`,
    w W'W of all rows. `values` of those, with their joint `covariance`, in units of their first guesses; `effects` on
    all rows, and how the map has `followed` them."""

    linear: Linear
    weight: sp.csr_array
    factor: Factor
    pulled: "Pulled"
    choice: Choice
    covariance: Array
    values: Array
    effects: sp.csc_array
    followed: Array

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
        tables = [replace(t, whitening=root, loss=SQUARED) for t, root in zip(linear.tables, roots, strict=True)]
        system = System(values.layout, tables=tables, fixed=held_at(at), names=linear.names)
        choice = choice or Choice.all(len(linear.columns))
        weight = _diagonal([np.swapaxes(root, 1, 2) @ root for root in roots])
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
            factor.factorise(system.linearise(values).hessian.numbers)
        return cls._with(linear, weight, factor, Pulled.of(linear, weight, factor, choice.inside), choice)

    @classmethod
    def _with(cls, linear: Linear, weight: sp.csr_array, factor: Factor, pulled: "Pulled", choice: Choice) -> "Fit":
        mine = np.searchsorted(pulled.which, choice.inside)
        if len(mine) < len(pulled.which):
            values, covariance = posterior(pulled.information[np.ix_(mine, mine)], pulled.slope[mine], choice.tau)
            effects, followed = pulled.effects[:, mine], np.ascontiguousarray(pulled.followed[:, mine])
        else:
            values, covariance = posterior(pulled.information, pulled.slope, choice.tau)
            effects, followed = pulled.effects, pulled.followed
        return cls(linear, weight, factor, pulled, choice, covariance, values, effects, followed)

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

    def moved(self) -> Values:
        """Where the map goes when systematic errors are taken out."""
        linear = self.linear
        step = self.factor.solve(linear.jacobian.T @ (self.weight @ (linear.errors - self.effects @ self.values)))
        return linear.at.gap.system.retract(linear.at.values, step)

    def left(self, errors: Array) -> Array:
        """What is left of errors (N, draws) of all rows when map and systematic errors have followed them."""
        pull = self.weight @ errors
        gradient = self.linear.jacobian.T @ pull
        step, rest = self.factor.solve(gradient), errors
        if len(self.values):
            values = self.covariance @ (self.effects.T @ pull - self.followed.T @ gradient)
            step -= self.followed @ values
            rest = rest - self.effects @ values
        left: Array = self.linear.jacobian @ step
        return np.subtract(rest, left, out=left)


@dataclass(frozen=True, eq=False)
class Pulled:
    """What the rows say of some systematic errors, `which` of all that there may be, when the map is eliminated: their
    `effects`, their `information` S and `slope` g, and how the map has `followed` each of them (unknowns, k)."""

    which: IntArray
    effects: sp.csc_array
    information: Array
    slope: Array
    followed: Array

    @classmethod
    def of(cls, linear: Linear, weight: sp.csr_array, factor: Factor, which: IntArray) -> "Pulled":
        """By the weights w W'W of all rows, and the factor of H."""
        effects = linear.effects if len(which) == len(linear.columns) else sp.csc_array(linear.effects[:, which])
        if not len(which):
            return cls(which, effects, np.zeros((0, 0)), np.zeros(0), np.zeros((linear.jacobian.shape[1], 0)))
        weighed = weight @ effects
        cross = (linear.jacobian.T @ weighed).toarray()
        followed = factor.solve(cross)
        information = (effects.T @ weighed).toarray() - cross.T @ followed
        pull = weight @ linear.errors
        slope = effects.T @ pull - followed.T @ (linear.jacobian.T @ pull)
        return cls(which, effects, 0.5 * (information + information.T), slope, followed)


def _diagonal(blocks: Sequence[Array]) -> sp.csr_array:
    """A matrix of blocks (m, r, r) along its diagonal."""
    data, columns, counts, start = [], [], [], 0
    for each in blocks:
        m, r = each.shape[:2]
        places: IntArray = start + np.arange(m * r).reshape(m, 1, r)
        data.append(each.ravel())
        columns.append(np.broadcast_to(places, each.shape).ravel())
        counts.append(np.full(m * r, r))
        start += m * r
    return sp.csr_array(
        (np.concatenate(data), np.concatenate(columns), np.concatenate([[0], np.cumsum(np.concatenate(counts))])),
        shape=(start, start),
    )
