"""The best rigid motion between two sets of shared points and poses, in closed form.

Minimise over T = (R, t):  sum_k w_k |p_k - (R q_k + t)|^2  +  kappa mean_k |P_k - R Q_k|_F^2 ,   sum_k w_k = 1,

points q -> p (positions of shared poses count among them), rotations Q -> P of shared poses. The translation drops out
at the centroids, and R is the rotation nearest to M = sum w (p - pbar)(q - qbar)' + kappa mean P Q': one SVD with the
determinant kept at +1 (Kabsch 1976; Umeyama 1991, eq. 40, without the scale).
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry.arrays import Array
from teamslam.geometry.pose import Pose


@dataclass(frozen=True, eq=False)
class Fit:
    """A rigid fit: `pose` maps source to target; `rms` [m] is what is left of the points; `rigidity` [m^2 or so] is how
    firmly the rotation is held: the smallest sum of two singular values of M (0: free to turn)."""

    pose: Pose
    rms: float
    rigidity: float


def align(
    source: Array,
    target: Array,
    weights: Array | None = None,
    *,
    source_rotations: Array | None = None,
    target_rotations: Array | None = None,
    kappa: float = 1.0,
    rotation_weights: Array | None = None,
) -> Fit:
    """The rigid fit of source onto target points (n, d), with optional shared rotations (m, d, d).

    `kappa` [m^2] weighs a rotation against points: one shared rotation counts like points that far from the centroid.
    `rotation_weights` v (m,) weigh each of them in the units of `weights` instead: sum_k v_k |P_k - R Q_k|_F^2.
    Law: if target = X.act(source), then fit.pose = X wherever the points (and rotations) determine it.
    Raises ModelError where there is nothing to fit.
    """
    if source.shape != target.shape:
        raise ModelError(f"source and target points must correspond: found {source.shape} and {target.shape}")
    if len(source) == 0:
        raise ModelError("a rigid fit needs at least one shared point or pose, found none")
    dim = source.shape[-1]
    w = np.ones(len(source)) if weights is None else np.asarray(weights, float)
    total = w.sum()
    w = w / total
    source_mean, target_mean = w @ source, w @ target
    moment = (w[:, None] * (target - target_mean)).T @ (source - source_mean)
    if source_rotations is not None and target_rotations is not None and len(source_rotations):
        turns = target_rotations @ np.swapaxes(source_rotations, -1, -2)
        shares = np.full(len(turns), kappa / len(turns)) if rotation_weights is None else rotation_weights / total
        moment = moment + (shares[:, None, None] * turns).sum(0)
    u, singular, vt = np.linalg.svd(moment)
    signs = np.ones(dim)
    signs[-1] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * signs) @ vt
    pose = Pose(rotation, target_mean - rotation @ source_mean)
    left_over = target - pose.act(source)
    # The rotation is held by sums of pairs of (signed) singular values; in the plane there is one pair.
    rigidity = float(singular[-2] + signs[-1] * singular[-1])
    return Fit(pose, float(np.sqrt(w @ np.sum(left_over**2, -1))), rigidity)
