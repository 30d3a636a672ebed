"""Rotations of space, SO(3), as 3x3 matrices. Tangent: the rotation vector w = angle * axis [rad].

Every function takes any leading batch axes. Laws: Exp(Log(R)) = R, and Log(Exp(w)) = w for |w| < pi.
Closed forms (Rodrigues) with series near zero, so that all are smooth there; Log near pi reads the axis from the
symmetric part of R, where the usual formula divides by sin(pi) = 0.
Source: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics" (2018), eqs. (131)-(148).
"""

import numpy as np

from teamslam.geometry.arrays import Array

DIM = 3  # of the space that is rotated
DOF = 3  # of the rotation

_SMALL = 1e-4  # below this angle the series are exact to double precision where they are used


def exp(w: Array) -> Array:
    """The rotation about w by |w|: (..., 3) -> (..., 3, 3)."""
    angle2 = np.sum(w * w, -1)[..., None, None]
    angle = np.sqrt(angle2)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    half = 0.5 * safe
    cosine = np.where(small, 0.5 - angle2 / 24.0, 0.5 * (np.sin(half) / half) ** 2)
    skew = hat(w)
    return np.eye(3) + sine * skew + cosine * (skew @ skew)


def log(rotation: Array) -> Array:
    """The rotation vector of length at most pi: (..., 3, 3) -> (..., 3).

    Read through the unit quaternion of largest component, which is exact at every angle, pi included.
    """
    r = rotation
    diagonal = np.stack([r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]], -1)
    trace = diagonal.sum(-1)
    # Four times the outer product q q' of the quaternion q = (w, x, y, z); its largest column is q up to scale.
    x, y, z = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    square_w = 1.0 + trace
    square_v = 1.0 + 2.0 * diagonal - trace[..., None]
    columns = np.stack(
        [
            np.stack([square_w, x, y, z], -1),
            np.stack([x, square_v[..., 0], xy, xz], -1),
            np.stack([y, xy, square_v[..., 1], yz], -1),
            np.stack([z, xz, yz, square_v[..., 2]], -1),
        ],
        -2,
    )
    best = np.argmax(np.stack([square_w, square_v[..., 0], square_v[..., 1], square_v[..., 2]], -1), -1)
    q = np.take_along_axis(columns, best[..., None, None], -2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    half = np.arctan2(sine, q[..., 0])
    small = sine < _SMALL
    # 2 half / sin(half), by series near zero: 2 (1 + sin^2 / 6)
    scale = np.where(small, 2.0 + sine * sine / 3.0, 2.0 * half / np.where(small, 1.0, sine))
    return np.asarray(scale[..., None] * q[..., 1:])


def hat(w: Array) -> Array:
    """The skew matrix W with W p = w x p: (..., 3) -> (..., 3, 3)."""
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    out = np.zeros((*w.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def right_jacobian(w: Array) -> Array:
    """Jr with Exp(w + d) ~ Exp(w) Exp(Jr d): (..., 3) -> (..., 3, 3)."""
    angle2 = np.sum(w * w, -1)[..., None, None]
    angle = np.sqrt(angle2)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    half = 0.5 * safe
    first = np.where(small, 0.5 - angle2 / 24.0, 0.5 * (np.sin(half) / half) ** 2)
    second = np.where(angle < 1e-2, 1.0 / 6.0 - angle2 / 120.0 + angle2**2 / 5040.0, (safe - np.sin(safe)) / safe**3)
    skew = hat(w)
    return np.asarray(np.eye(3) - first * skew + second * (skew @ skew))


def right_jacobian_inverse(w: Array) -> Array:
    """Jr^-1 with Log(Exp(w) Exp(d)) ~ w + Jr^-1 d, for |w| < 2 pi: (..., 3) -> (..., 3, 3)."""
    angle2 = np.sum(w * w, -1)[..., None, None]
    angle = np.sqrt(angle2)
    near = angle < 1e-2
    safe = np.where(near, 1.0, angle)
    half = 0.5 * safe
    factor = np.where(near, 1.0 / 12.0 + angle2 / 720.0 + angle2**2 / 30240.0, (1.0 - half / np.tan(half)) / safe**2)
    skew = hat(w)
    return np.asarray(np.eye(3) + 0.5 * skew + factor * (skew @ skew))


def adjoint(rotation: Array) -> Array:
    """A with R Exp(w) R' = Exp(A w), which is R itself: (..., 3, 3) -> (..., 3, 3)."""
    return rotation
