"""Covariances between GTSAM's order and charts, as JRL files have them, and teamslam's.

e = M e' to first order for teamslam's error e and GTSAM's e' (up to one common sign), so covariance = M covariance' M':

- poses: the rotation first in space, and the right tangent: M = A P (`charts`), P the change of order;
- bearing and range: the bearing first, in space in GTSAM's tangent basis B' at the measured direction: its first vector
  is b x a, a the axis along which b has its smallest part; M = diag(1, B' B'') P.
"""

import numpy as np

from teamslam.geometry import Array, direction_basis
from teamslam.io.graphs.charts import chart
from teamslam.model import MODELS


def covariance_here(covariance: Array, value: Array, model: str, dim: int) -> Array:
    """Covariances (..., r, r) of JRL in teamslam's chart; values (..., size) as in MODELS."""
    m = _change(value, model, dim)
    return np.asarray(m @ covariance @ np.swapaxes(m, -1, -2))


def covariance_there(covariance: Array, value: Array, model: str, dim: int) -> Array:
    """Covariances (..., r, r) of teamslam's in JRL's chart. Law: covariance_here(covariance_there(c)) = c."""
    m = np.linalg.inv(_change(value, model, dim))
    return np.asarray(m @ covariance @ np.swapaxes(m, -1, -2))


def gtsam_basis(direction: Array) -> Array:
    """GTSAM's two tangents (..., 3, 2) at unit vectors (..., 3)."""
    axis = np.eye(3)[np.argmin(np.abs(direction), -1)]  # the first of equal ones
    first = np.cross(direction, axis)
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], -1)


def _change(value: Array, model: str, dim: int) -> Array:
    """M (..., r, r)."""
    rows = MODELS[model].residual_rows(dim)
    if model in ("relative_pose", "pose"):
        order = np.eye(rows) if dim == 2 else np.roll(np.eye(6), 3, 1)
        charts = chart(value.reshape(-1, value.shape[-1]), dim).reshape(*value.shape[:-1], rows, rows)
        return np.asarray(charts @ order)
    if model == "range_bearing":
        out = np.zeros((*value.shape[:-1], rows, rows))
        out[..., 0, -1] = 1.0
        direction = value[..., 1:]
        turned = 1.0 if dim == 2 else np.swapaxes(direction_basis(direction), -1, -2) @ gtsam_basis(direction)
        out[..., 1:, :-1] = turned
        return out
    return np.eye(rows)
