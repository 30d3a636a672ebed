"""Noise as a whitening matrix: W with W'W the information of a measurement, so that W e is counted in sigmas.

A measurement may say nothing at all in some direction: its information is singular, and W has as many rows that are not
zero as the information has directions. W stays square, with rows of zeros for what was not measured: a zero row costs
nothing, pulls nowhere and is counted as no measurement (`ranks`), and tables may hold rows of every rank.
"""

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray

_SINGULAR = 1e-14  # least eigenvalue of a correlation that rounding leaves standing
_WRITTEN = 1e-5  # how far below zero it may seem where numbers were written with six digits


def whitening(covariance: Array) -> Array:
    """W (..., r, r) with covariance^-1 = W'W: the inverse of the lower Cholesky factor.

    Law: W covariance W' = 1. Raises ModelError for a covariance that is not finite, symmetric and positive definite,
    naming the first row at fault.
    """
    correlation, sd = _correlation(covariance, "covariance")
    indefinite = (sd.min(-1) <= 0.0) | (np.linalg.eigvalsh(correlation)[:, 0] <= _SINGULAR)
    if indefinite.any():
        bad = int(np.flatnonzero(indefinite)[0])
        variances = np.diagonal(np.reshape(covariance, correlation.shape)[bad])
        raise ModelError(
            f"covariance {bad} is not positive definite (smallest variance {variances.min():.3g}); "
            f"variances must be above zero and correlations below one"
        )
    return np.asarray(np.linalg.inv(np.linalg.cholesky(correlation)) / sd[:, None, :]).reshape(np.shape(covariance))


def whitening_of_information(information: Array) -> Array:
    """W (..., r, r), lower triangular, with W'W = information, which may be singular: row i of W is zero where number i
    adds nothing to those after it.

    Raises ModelError for a matrix that is not finite, symmetric and without negative eigenvalues, or that is zero,
    naming the first row at fault.
    """
    correlation, scale = _correlation(information, "information")
    eigenvalues, vectors = np.linalg.eigh(correlation)
    diagonal = np.diagonal(np.reshape(information, correlation.shape), axis1=1, axis2=2)
    bad = (eigenvalues[:, 0] < -_WRITTEN) | (diagonal < 0.0).any(-1) | (scale.max(-1) == 0.0)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise ModelError(
            f"information {first} says nothing: it is zero"
            if scale[first].max() == 0.0
            else f"information {first} has a negative eigenvalue ({eigenvalues[first, 0]:.3g} of a correlation): "
            f"in some direction the measurement would be worse than none"
        )
    singular = eigenvalues[:, 0] <= _SINGULAR
    # Cholesky from the last row up: J correlation J = L L' with J the reversal, so W = J L' J is lower triangular.
    factor = np.zeros_like(correlation)
    factor[~singular] = np.linalg.cholesky(correlation[~singular][:, ::-1, ::-1])
    if singular.any():
        kept = np.where(eigenvalues[singular] > _SINGULAR, eigenvalues[singular], 0.0)
        nearest = (vectors[singular] * kept[:, None, :]) @ np.swapaxes(vectors[singular], 1, 2)
        factor[singular] = _semidefinite_cholesky(nearest[:, ::-1, ::-1], (kept > 0.0).sum(-1))
    triangle = np.swapaxes(factor, 1, 2)[:, ::-1, ::-1] * scale[:, None, :]
    return np.ascontiguousarray(triangle).reshape(np.shape(information))


def ranks(whitening: Array) -> IntArray:
    """How many numbers are measured (...): rows of W (..., r, r) that are not zero."""
    return np.asarray((whitening != 0.0).any(-1).sum(-1))


def variances(whitening: Array) -> Array:
    """The variance (..., r) of each number measured, whatever the others are; infinite where it is left open."""
    flat = whitening.reshape(-1, *whitening.shape[-2:])
    size = flat.shape[-1]
    out = np.empty(flat.shape[:-1])
    whole = ranks(flat) == size
    out[whole] = np.sum(np.linalg.inv(flat[whole]) ** 2, -1)
    for row in np.flatnonzero(~whole):
        scale = np.linalg.norm(flat[row], axis=0)
        unit = flat[row] / np.where(scale > 0.0, scale, 1.0)
        eigenvalues, vectors = np.linalg.eigh(unit.T @ unit)
        seen = eigenvalues > _SINGULAR * size
        spread = np.sum(vectors[:, seen] ** 2 / eigenvalues[seen], -1) / np.where(scale > 0.0, scale, 1.0) ** 2
        out[row] = np.where((np.abs(vectors[:, ~seen]) > 1e-7).any(-1), np.inf, spread)
    return out.reshape(whitening.shape[:-1])


def _correlation(matrix: Array, name: str) -> tuple[Array, Array]:
    """Matrices (n, r, r) scaled to a unit diagonal, so that the units of the rows (metres beside microradians) do not
    matter, and the scales (n, r): roots of the diagonal, 0 where that is not above zero."""
    flat = np.asarray(matrix, float).reshape(-1, *np.shape(matrix)[-2:])
    if not np.isfinite(flat).all():
        bad = int(np.flatnonzero(~np.isfinite(flat).all((1, 2)))[0])
        raise ModelError(f"{name} {bad} holds a number that is not finite")
    diagonal = np.diagonal(flat, axis1=1, axis2=2)
    scale = np.sqrt(np.maximum(diagonal, 0.0))
    divisor = np.where(scale > 0.0, scale, 1.0)
    correlation = flat / (divisor[:, :, None] * divisor[:, None, :])
    swapped = np.swapaxes(correlation, -1, -2)
    lopsided = np.abs(correlation - swapped).max((1, 2), initial=0.0) > 1e-6
    if lopsided.any():
        raise ModelError(f"{name} {int(np.flatnonzero(lopsided)[0])} is not symmetric")
    return 0.5 * (correlation + swapped), scale


def _semidefinite_cholesky(matrix: Array, rank: IntArray) -> Array:
    """L (n, r, r) lower triangular with matrix = L L' and as many columns that are not zero as the matrix has rank.

    What rounding leaves of a pivot that is zero is more where the matrix is close to a lower rank.
    """
    zero = np.full(len(matrix), 1e-12)
    while True:
        left, factor = matrix.copy(), np.zeros_like(matrix)
        for j in range(matrix.shape[-1]):
            pivot = left[:, j, j]
            used = pivot > zero
            root = np.sqrt(np.where(used, pivot, 1.0))
            factor[:, j:, j] = np.where(used[:, None], left[:, j:, j] / root[:, None], 0.0)
            left -= factor[:, :, j, None] * factor[:, None, :, j]
        more = (factor != 0.0).any(1).sum(-1) > rank
        if not more.any():
            return factor
        zero[more] *= 10.0
