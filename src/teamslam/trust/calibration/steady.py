"""A fit of which odometry's noise alone changes, as often as it is settled (see `balance`).

What all other rows say by errors e, measured and drawn, and by effects D of systematic errors,

    G  =  sum J'W e ,    q  =  sum D'W e ,    B  =  sum J'W D ,    S  =  sum D'W D

stays as it is and is found once. Each time rows of odometry are added to these, and the fit is made as ever (see
`posterior`); but what is left is asked of these rows alone, as nothing else pulls at their noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array
from teamslam.model.sparse import sp
from teamslam.solver import Factor
from teamslam.trust.calibration.choice import Choice
from teamslam.trust.calibration.drawn import beside_drawn, felt_by
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.posterior import block_diagonal, crossed
from teamslam.trust.calibration.rows import Effects, Linear


@dataclass(frozen=True, eq=False)
class Said:
    """What rows say: G (unknowns, draws), q (k, draws), B (unknowns, k) and S (k, k)."""

    gradient: Array
    pull: Array
    cross: Array
    own: Array

    @classmethod
    def by(cls, linear: Linear, weight: sp.csr_array, effects: Effects, errors: Array) -> "Said":
        """By some rows, their errors (N, draws) and weights (N, N)."""
        pull = weight @ errors
        return cls(linear.jacobian.T @ pull, effects.pull(pull), *crossed(linear, weight, effects))


class Steady:
    """What rows leave of errors, where tables `moving` have noise that changes and all others, by `now`, `left` and
    `roots`, have not."""

    def __init__(
        self,
        linear: Linear,
        moving: Sequence[int],
        choice: Choice,
        now: Sequence[Noise],
        white: Array,
        left: Sequence[Array],
        roots: Sequence[Array],
    ) -> None:
        still = [k for k in range(len(linear.tables)) if k not in moving]
        parts = linear.by_tables(white)
        others = linear.only(still)
        errors = beside_drawn(others, [now[k] for k in still], [parts[k] for k in still])
        felt = felt_by([now[k] for k in still], [left[k] for k in still], errors, others)
        effects = others.effects.only(choice.inside)
        weight = block_diagonal(others, [roots[k] for k in still])
        self._said = Said.by(others, weight, effects, errors if felt is None else felt)
        for k in still:
            linear.system.set_whitening(k, roots[k])
        self._linear, self._places, self._choice = linear.only(moving), tuple(moving), choice
        self._effects = self._linear.effects.only(choice.inside)
        self._white, self._left = [parts[k] for k in moving], [left[k] for k in moving]
        self._factor: Factor = linear.at.gap.system.factor(linear.at.values)

    def leaves(self, now: Sequence[Noise]) -> list[Array]:
        """What is left (m, rows, 1 + draws) of errors measured and drawn by the noise of each of the tables that have
        another one `now`; and the fit by it is made."""
        linear, said, effects = self._linear, self._said, self._effects
        roots = [np.sqrt(n.weights(left))[..., None] * n.whitening for n, left in zip(now, self._left, strict=True)]
        for k, root in zip(self._places, roots, strict=True):
            linear.system.set_whitening(k, root)
        self._factor.factorise(linear.system.linearise(linear.at.values).hessian.numbers)
        errors = beside_drawn(linear, now, self._white)
        felt = felt_by(now, self._left, errors, linear)
        self._weight = block_diagonal(linear, roots)
        mine = Said.by(linear, self._weight, effects, errors if felt is None else felt)
        self._half = self._factor.half(said.cross + mine.cross)
        information = said.own + mine.own - self._half.T @ self._half + np.diag(self._choice.tau**-2.0)
        self._covariance = np.linalg.inv(information)
        half = self._factor.half(said.gradient + mine.gradient)
        values = self._covariance @ (said.pull + mine.pull - self._half.T @ half)
        left = linear.jacobian @ self._factor.draws(half - self._half @ values)
        np.subtract(errors, left, out=left)
        effects.along(values, left)
        return linear.by_tables(left)

    def information(self, along: Array) -> Array:
        """1/2 y'P y (k, k) for numbers y (N, k) at the rows whose noise changes, by the fit that was made."""
        pull = self._weight @ along
        half = self._factor.half(self._linear.jacobian.T @ pull)
        told = self._effects.pull(pull) - self._half.T @ half
        return np.asarray(0.5 * (along.T @ pull - half.T @ half - told.T @ self._covariance @ told))
