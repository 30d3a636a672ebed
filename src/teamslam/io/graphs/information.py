"""Noise stated as information: whitening W with W'W = information, and back.

Information may have directions of zero (a constraint in the plane of something in space, a range written as a point):
they say nothing, and W has rows of zeros for them. Information that is negative in a direction is no information.
"""

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array

PRINTED = 1e-5  # files print about six digits: a direction of zero may come out negative by as much
NOTHING = 1e-12  # of the largest: below this a direction is one of zero


def whitening_of_information(information: Array) -> Array:
    """W (m, r, r) with W'W = information: lower triangular, or with rows of zeros where information is singular.

    Judged in units in which every diagonal is one, so that metres beside microradians do not matter. ModelError for a
    matrix that is negative in a direction, naming the first row at fault.
    """
    symmetric = 0.5 * (information + np.swapaxes(information, 1, 2))
    diagonal = np.diagonal(symmetric, axis1=1, axis2=2)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    unit = symmetric / (scale[:, :, None] * scale[:, None, :])
    eigenvalues, vectors = np.linalg.eigh(unit)
    _refuse(eigenvalues, diagonal)
    regular = (eigenvalues[:, 0] > NOTHING * eigenvalues[:, -1]) & (eigenvalues[:, 0] > 0.0)
    out = np.empty_like(symmetric)
    # Cholesky from the last row up: J information J = L L' with J the reversal, so W = J L' J is lower triangular.
    factor = np.linalg.cholesky(unit[regular][:, ::-1, ::-1])
    out[regular] = np.swapaxes(factor, 1, 2)[:, ::-1, ::-1] * scale[regular][:, None, :]
    singular = ~regular
    known = np.where(eigenvalues > NOTHING * eigenvalues[:, -1:], eigenvalues, 0.0)[singular]
    rows = np.sqrt(known)[:, :, None] * np.swapaxes(vectors[singular], 1, 2)
    out[singular] = rows[:, ::-1] * scale[singular][:, None, :]
    return out


def _refuse(eigenvalues: Array, diagonal: Array) -> None:
    """ModelError for the first row that is negative in a direction."""
    largest = np.maximum(eigenvalues[:, -1], 0.0)
    bad = np.flatnonzero((diagonal < 0.0).any(1) | (eigenvalues[:, 0] < -PRINTED * largest))
    if len(bad):
        first = int(bad[0])
        raise ModelError(
            f"information {first} is negative in a direction (smallest eigenvalue {eigenvalues[first, 0]:.3g} where "
            f"diagonals are scaled to 1); every direction needs information of zero or more"
        )


def information_of_whitening(whitening: Array) -> Array:
    """W'W, exactly symmetric."""
    information = np.swapaxes(whitening, -1, -2) @ whitening
    return np.asarray(0.5 * (information + np.swapaxes(information, -1, -2)))


def has_covariance(whitening: Array) -> bool:
    """True where every row (m, r, r) says something about every direction."""
    lengths = np.linalg.norm(whitening, axis=1, keepdims=True)
    if not len(whitening):
        return True
    return bool((lengths > 0.0).all() and (np.linalg.matrix_rank(whitening / lengths) == whitening.shape[-1]).all())


def covariance_of_whitening(whitening: Array) -> Array:
    """(W'W)^-1, exactly symmetric."""
    root = np.linalg.inv(whitening)
    covariance = root @ np.swapaxes(root, -1, -2)
    return np.asarray(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
