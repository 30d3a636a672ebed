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
