"""The residuals of the problem and their derivatives in NumPy, one measurement at a time: for the peers whose cost
functions are written in Python.

A pose moves by T + dT, R Exp(w), and derivatives are by [dT, w] (w is an angle in the plane); a landmark by p + dp.
"""

from math import atan2, cos, sin, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from problems import SIGMA_P, SIGMA_R, SIGMA_T, log

Pose = tuple[np.ndarray, np.ndarray]  # T (d,) and R (d, d)


def step(z: Pose, first: Pose, second: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whitened odometry residual [zT - R1'(T2 - T1); Log((R1'R2)' zR)], and its derivatives by both poses."""
    (T1, R1), (T2, R2) = first, second
    d = len(T1)
    back = R1.T
    h = back @ (T2 - T1)
    turned, by_first, by_second = _turn(R2.T @ R1 @ z[1], z[1])
    n = d + len(turned)
    e, A, B = np.empty(n), np.zeros((n, n)), np.zeros((n, n))
    e[:d], e[d:] = (z[0] - h) / SIGMA_T, turned / SIGMA_R
    A[:d, :d] = back / SIGMA_T
    B[:d, :d] = -A[:d, :d]
    A[:d, d:] = _turned_back(h) / -SIGMA_T
    A[d:, d:], B[d:, d:] = by_first / SIGMA_R, by_second / SIGMA_R
    return e, A, B


def sighting(z: np.ndarray, pose: Pose, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whitened residual z - R'(p - T) of a landmark's sighting, and its derivatives by the pose and by p."""
    T, R = pose
    back = R.T / SIGMA_P
    h = back @ (p - T)
    return z / SIGMA_P - h, np.concatenate([back, -_turned_back(h)], 1), -back


def rotation(turn: np.ndarray) -> np.ndarray:
    """The matrix of an angle (1,), or of a unit quaternion x y z w (4,)."""
    if len(turn) == 1:
        c, s = cos(turn[0]), sin(turn[0])
        return np.array([[c, -s], [s, c]])
    x, y, z, w = turn.tolist()
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ])  # fmt: skip


def turns(R: np.ndarray) -> np.ndarray:
    """Angles (n, 1) or quaternions (n, 4) of rotations (n, d, d)."""
    return log(R) if R.shape[-1] == 2 else Rotation.from_matrix(R).as_quat()


def by_numbers(by_turn: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Derivatives by a turn w of R Exp(w), as derivatives by the block's numbers."""
    if len(turn) == 1:
        return by_turn
    x, y, z, w = turn.tolist()
    return by_turn @ (2.0 * np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]]))


def _turned_back(v: np.ndarray) -> np.ndarray:
    """The derivative of Exp(-w) v by w, at w = 0."""
    if len(v) == 2:
        return np.array([[v[1]], [-v[0]]])
    return _hat(v)


def _turn(M: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log(M) of M = R2' R1 z, and its derivatives by how R1 and R2 turn."""
    if len(M) == 2:
        return np.array([atan2(M[1, 0], M[0, 0])]), np.eye(1), -np.eye(1)
    v = 0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])
    sine, cosine = sqrt(v @ v), 0.5 * (M[0, 0] + M[1, 1] + M[2, 2] - 1.0)
    t = atan2(sine, cosine)
    w = v * (t / sine) if sine > 0.0 else v
    W = _hat(w)
    c = 1.0 / t**2 - (1.0 + cos(t)) / (2.0 * t * sin(t)) if t > 1e-4 else 1.0 / 12.0
    inverse = np.eye(3) + 0.5 * W + c * (W @ W)
    return w, inverse @ z.T, -inverse @ M.T


def _hat(v: np.ndarray) -> np.ndarray:
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
