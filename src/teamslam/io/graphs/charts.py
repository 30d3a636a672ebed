"""Noise of relative poses between the charts of other programs and teamslam's mixed chart.

For a measured pose z = (zR, zT) and a prediction h, with e = [zT - hT ; Log(hR' zR)] teamslam's residual (and the
absolute `pose` model alike, h being the pose itself):

    g2o           error of z^-1 h as [translation ; vector part of the quaternion]
    GTSAM, JRL    error Log_SE(z^-1 h), full logarithm of SE(d)

To first order at the measurement both are e' = -A^-1 e with A = diag(zR, c 1): the translation error is turned into
the measured frame, and c = 1, but c = 2 for g2o's quaternions, whose vector part is half the angle. (In the plane g2o's
relation is exact.) So covariance = A covariance' A' and information = A^-T information' A^-1.
"""

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array


def chart(values: Array, dim: int, half_angle: bool = False) -> Array:
    """A (m, r, r) of measured poses, values (m, size) as in MODELS' relative_pose: e = -A e'."""
    m, rows = len(values), 3 if dim == 2 else 6
    out = np.zeros((m, rows, rows))
    out[:, :dim, :dim] = values[:, dim:].reshape(m, dim, dim)
    scale = 2.0 if half_angle and dim == 3 else 1.0
    out[:, range(dim, rows), range(dim, rows)] = scale
    return out


def inverse_chart(values: Array, dim: int, half_angle: bool = False) -> Array:
    """A^-1 (m, r, r): A is orthogonal but for its scale."""
    a = chart(values, dim, half_angle)
    a[:, range(dim, a.shape[1]), range(dim, a.shape[1])] **= -1
    a[:, :dim, :dim] = np.swapaxes(a[:, :dim, :dim], 1, 2).copy()
    return a


def whitening_of_information(information: Array) -> Array:
    """W (m, r, r), lower triangular, with W'W = information.

    ModelError for a matrix that is not positive definite, naming the first row at fault.
    """
    symmetric = 0.5 * (information + np.swapaxes(information, 1, 2))
    eigenvalues = np.linalg.eigvalsh(symmetric)
    bad = eigenvalues[:, 0] <= 1e-14 * np.maximum(eigenvalues[:, -1], 1e-300)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise ModelError(
            f"information {first} is not positive definite (smallest eigenvalue {eigenvalues[first, 0]:.3g}); "
            f"every direction of the measurement needs information above zero"
        )
    # Cholesky from the last row up: J information J = L L' with J the reversal, so W = J L' J is lower triangular.
    factor = np.linalg.cholesky(symmetric[:, ::-1, ::-1])
    return np.ascontiguousarray(np.swapaxes(factor, 1, 2)[:, ::-1, ::-1])


def information_of_whitening(whitening: Array) -> Array:
    """W'W, exactly symmetric."""
    information = np.swapaxes(whitening, -1, -2) @ whitening
    return np.asarray(0.5 * (information + np.swapaxes(information, -1, -2)))


def covariance_of_whitening(whitening: Array) -> Array:
    """(W'W)^-1, exactly symmetric."""
    root = np.linalg.inv(whitening)
    covariance = root @ np.swapaxes(root, -1, -2)
    return np.asarray(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
