"""Graduated non-convexity: outliers found without a good start, by turning a convex problem slowly into a robust one.

Truncated least squares counts a measurement with squared whitened residual s in full up to a threshold c^2, and not
at all beyond. Its surrogate with control mu is convex for mu -> 0 and becomes the truncated loss for mu -> infinity;
the weight of a measurement on the way is

    w = 1                                  where s <= c^2 mu / (mu + 1)
    w = 0                                  where s >= c^2 (mu + 1) / mu
    w = sqrt(c^2 mu (mu + 1) / s) - mu     between

Source: Yang, Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for Robust Spatial Perception" (RA-L 2020), eqs.
12-14.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray
from teamslam.model import Values, chi2_quantile
from teamslam.solver.optimise import DEFAULTS, Options, optimise
from teamslam.solver.solution import Solution
from teamslam.solver.system import System

_GROWTH = 1.4  # of mu per round, the factor of the paper
_MAX_ROUNDS = 100
_NEXT_TO_NOTHING = 1e-9  # of weight: what all rows on it are wrong of is still somewhere
_WARM = 0.5  # of mu, where it is known what to begin with: rows count in part up to three times the gate


@dataclass(frozen=True, eq=False)
class Graduated:
    """A solution with its inliers: `inliers[i]` (m,) for every row of table i; tables that were trusted are all
    true."""

    solution: Solution
    inliers: tuple[BoolArray, ...]

    @property
    def rejected(self) -> int:
        """How many measurements were counted out."""
        return sum(int((~mask).sum()) for mask in self.inliers)


def optimise_graduated(
    system: System,
    start: Values,
    suspects: Sequence[int],
    *,
    probability: float = 0.99,
    gates: Mapping[int, Array] | None = None,
    first: Mapping[int, BoolArray] | None = None,
    options: Options = DEFAULTS,
) -> Graduated:
    """The truncated least squares estimate, where the tables `suspects` (places in system.tables) may hold outliers.

    `probability` is the only knob: the share of good measurements that passes the gate c^2, the quantile of the
    chi-square distribution with as many degrees of freedom as a row measures; or `gates` c^2 (m,) are given for each
    suspect. `first` (m,): rows to begin with, where they are known from elsewhere; the surrogate is then nearly the
    truncated loss from the start. The information of the solution is that of the inliers. Raises InputError for a
    probability outside (0, 1), SolveError as `optimise` does.
    """
    if not 0.0 < probability < 1.0:
        raise InputError(f"the probability of the gate lies between 0 and 1, found {probability}")
    if gates is None:
        gates = {i: chi2_quantile(probability, np.maximum(system.tables[i].ranks, 1)) for i in suspects}
    for i, rows in (first or {}).items():
        system.set_weights(i, np.maximum(rows, _NEXT_TO_NOTHING))
    solution = optimise(system, start, options)
    squared = {i: np.sum(system.whitened(i, solution.values) ** 2, -1) for i in suspects}
    excess = max((float((s / gates[i]).max(initial=0.0)) for i, s in squared.items()), default=0.0)
    weights: dict[int, Array] = {i: np.ones(len(s)) for i, s in squared.items()}
    mu = 1.0 / max(2.0 * excess - 1.0, 1e-6)
    if first is not None:
        mu = max(mu, _WARM)
    if excess > 1.0:
        for _ in range(_MAX_ROUNDS):
            weights = {i: _weight(s, gates[i], mu) for i, s in squared.items()}
            for i, w in weights.items():
                system.set_weights(i, np.maximum(w, _NEXT_TO_NOTHING))
            solution = optimise(system, solution.values, options)
            squared = {i: np.sum(system.whitened(i, solution.values) ** 2, -1) for i in suspects}
            if all(np.all((w == 0.0) | (w == 1.0)) for w in weights.values()) and mu > 1.0:
                break
            mu *= _GROWTH
    elif first is not None:
        for i in first:
            system.set_weights(i, None)
        solution = optimise(system, solution.values, options)
    inliers = tuple(
        weights[i] > 0.5 if i in weights else np.ones(len(table), bool) for i, table in enumerate(system.tables)
    )
    _ = solution.hessian  # made while the weights stand
    return Graduated(solution, inliers)


def _weight(squared: Array, gate: Array, mu: float) -> Array:
    between = np.sqrt(gate * mu * (mu + 1.0) / np.maximum(squared, 1e-300)) - mu
    weight = np.where(squared >= gate * (mu + 1.0) / mu, 0.0, between)
    return np.where(squared <= gate * mu / (mu + 1.0), 1.0, weight)
