"""Rotations of the plane, SO(2), as 2x2 matrices. Tangent: one angle w [rad], anticlockwise positive.

Every function takes any leading batch axes. Laws: Exp(Log(R)) = R, and Log(Exp(w)) = w for |w| < pi.
The sister file `so3.py` offers the same names; `pose.py` is written once on top of both.
"""

import numpy as np

from teamslam.geometry.arrays import Array

DIM = 2  # of the space that is rotated
DOF = 1  # of the rotation


def exp(w: Array) -> Array:
    """The rotation by angle w: (..., 1) -> (..., 2, 2)."""
    c, s = np.cos(w[..., 0]), np.sin(w[..., 0])
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def log(rotation: Array) -> Array:
    """The angle in (-pi, pi] of a rotation: (..., 2, 2) -> (..., 1)."""
    return np.asarray(np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))[..., None]


def hat(w: Array) -> Array:
    """The skew matrix W with W p = d/dt Exp(t w) p at t = 0: (..., 1) -> (..., 2, 2)."""
    zero = np.zeros_like(w[..., 0])
    return np.stack([np.stack([zero, -w[..., 0]], -1), np.stack([w[..., 0], zero], -1)], -2)


def right_jacobian(w: Array) -> Array:
    """Jr with Exp(w + d) ~ Exp(w) Exp(Jr d). In the plane it is 1: (..., 1) -> (..., 1, 1)."""
    return np.ones((*w.shape, 1))


def right_jacobian_inverse(w: Array) -> Array:
    """Jr^-1 with Log(Exp(w) Exp(d)) ~ w + Jr^-1 d. In the plane it is 1: (..., 1) -> (..., 1, 1)."""
    return np.ones((*w.shape, 1))


def adjoint(rotation: Array) -> Array:
    """A with R Exp(w) R' = Exp(A w). The plane's rotations commute, so A = 1: (..., 2, 2) -> (..., 1, 1)."""
    return np.ones((*rotation.shape[:-2], 1, 1))
