"""Least squares over a map and its unknowns together, the map eliminated: one step of Gauss-Newton, and what is known.

    [ H   -C ] [d]   [ J' W e                   ]        H = J'WJ,  C = J'WD,  W = W'W of each row by its loss
    [-C'   S ] [q] = [-D' W e - (p - p0) / s^2  ]        S = D'WD + 1 / s^2

    (S - C' H^-1 C) q  =  C' H^-1 J'We - D'We - (p - p0) / s^2

The covariance of p beside the map is the inverse of the matrix on the left.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import AtMap
from teamslam.model import Table, Unknowns
from teamslam.model.sparse import sp
from teamslam.solver import Factor
from teamslam.trust.calibration.rows import held_at, linearised
from teamslam.trust.unknowns.effects import Effects

CONTRADICTS = 5.0  # sigmas: these take rows for independent


@dataclass(frozen=True, eq=False)
class Normal:
    """The `step` (k,) of the unknowns to their optimum and their `covariance` (k, k) beside the map, 0 for those that
    are `held` (k,) as they were stated: nobody called them uncertain, and the rows do not contradict that; and the
    standard deviations (k,) that the rows would tell them with."""

    step: Array
    covariance: Array
    held: BoolArray
    sigmas: Array


def normal_at(maps: Sequence[AtMap], unknowns: Unknowns, effects: Effects, kept: BoolArray | None = None) -> Normal:
    """The normal equations of the unknowns at the maps of all components of a log, solved; those that are `kept` (k,)
    stay as stated whatever rows say. SolveError where its rows do not determine a map."""
    prior, stated, useful = (np.array([getattr(u, f) for u in unknowns.each]) for f in ("prior", "stated", "useful"))
    clocks, drifts = (np.array([getattr(u, f) for u in unknowns.each]) for f in ("clock_of", "drift_of"))
    own = np.diag(prior**-2.0)
    slope = (stated - unknowns.values) / prior**2
    for at in maps:
        left, pull = eliminated(at, lambda table, at=at: effects.at(at, table))  # type: ignore[misc]
        own, slope = own + left, slope + pull
    own = 0.5 * (own + own.T)
    sigmas = np.sqrt(np.diag(beside_prior(own, prior)))
    free = _free(own, slope, stated - unknowns.values, prior, useful, (clocks, drifts), kept)
    held = ~np.isin(np.arange(len(own)), free)
    covariance = np.zeros_like(own)
    covariance[np.ix_(free, free)] = beside_prior(own[np.ix_(free, free)], prior[free])
    back = np.where(held, stated - unknowns.values, 0.0)
    step = covariance @ (slope - own @ back) + back
    sigmas[free] = np.sqrt(np.diag(covariance))[free]
    return Normal(step, covariance, held, sigmas)


def _free(
    own: Array,
    slope: Array,
    back: Array,
    prior: Array,
    useful: Array,
    clocks: tuple[IntArray, IntArray],
    kept: BoolArray | None = None,
) -> IntArray:
    """Which unknowns are moved: all that somebody called uncertain, those of which the rows contradict what is stated,
    and drifts of clocks whose offset they contradict, since a clock that nobody set was not tuned either; the least
    contradicted stays first. `back` (k,) leads to what is stated; `clocks` (k,) are the robots of whose clock each is
    the offset, or the drift."""
    free = np.arange(len(own)) if kept is None else np.flatnonzero(~kept)
    while len(free):
        known = beside_prior(own[np.ix_(free, free)], prior[free])
        sigmas = np.sqrt(np.diag(known))
        stays = np.setdiff1d(np.arange(len(own)), free)
        step = known @ (slope[free] - own[np.ix_(free, stays)] @ back[stays])
        off = (clocks[1][free] > 0) & np.isin(clocks[1][free], clocks[0][free])
        against = np.where((useful[free] > 0.0) & ~off, np.abs(step - back[free]) / sigmas, np.inf)
        if against.min() >= CONTRADICTS:
            break
        free = np.delete(free, int(np.argmin(against)))
    return free


def beside_prior(information: Array, prior: Array) -> Array:
    """The covariance (k, k) of numbers of which rows and a prior of standard deviations (k,) bring an `information`
    (k, k), the prior in it: positive definite, and no number known less than by its prior. What elimination leaves of a
    direction that rows say nothing of is rounding of what was subtracted, and may be less than nothing: it is taken for
    the least that the prior allows there."""
    scale = np.sqrt(np.maximum(np.diag(information), prior**-2.0))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    root = vectors / scale[:, None] / np.sqrt(np.maximum(values, np.min((prior * scale) ** -2.0, initial=1.0)))
    root *= np.minimum(prior / np.linalg.norm(root, axis=1), 1.0)[:, None]
    return np.asarray(root @ root.T)


def eliminated(at: AtMap, effect: Callable[[Table], Array]) -> tuple[Array, Array]:
    """S - C' H^-1 C (k, k) and C' H^-1 J'We - D'We (k,) of one map, without priors; `effect` gives de/dp (m, rows, k)
    of the rows of a table."""
    free = at.gap.free
    hessian, gradient = sp.csr_array((free.dof, free.dof)), np.zeros(free.dof)
    cross, own, pull = [], [], []
    both = linearised(at.tables, at.values, held_at(at), at.joined.names)
    for table, (error, jacobian) in zip(at.tables, both, strict=True):
        whitening = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
        weight = np.sqrt(table.loss.weight(np.sum(table.whitened(at.values) ** 2, -1)))
        white = weight[:, None, None] * whitening
        e, D = (white @ error[..., None]).ravel(), (white @ effect(table)).reshape(error.size, -1)
        J = sp.csr_array(sp.block_diag(list(white), format="csr") @ jacobian)
        hessian = hessian + J.T @ J
        gradient += J.T @ e
        cross.append(J.T @ D)
        own.append(D.T @ D)
        pull.append(D.T @ e)
    factor = Factor.of(free, sp.csr_array(hessian), at.joined.names, at.joined.values)
    C = np.sum(cross, 0)
    followed = factor.solve(np.column_stack([gradient, C]))
    return np.sum(own, 0) - C.T @ followed[:, 1:], C.T @ followed[:, 0] - np.sum(pull, 0)
