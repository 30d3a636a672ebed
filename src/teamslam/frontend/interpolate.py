"""Poses between stamps: translation along the straight line, rotation along the shortest turn; or on the smooth way
through the four samples about an instant.

X(t) = X_a (+) f (X_b (-) X_a),   f = (t - t_a) / (t_b - t_a)      so headings wrap as they should
X(t) = X_a (+) sum_k L_k(t) (X_k (-) X_a),  k = a-1 .. a+2         L_k Lagrange's cubics
"""

import numpy as np

from teamslam.geometry import BoolArray, IntArray, Pose

TURNED = 1.0  # [rad] between samples: with more, no angle is a polynomial of time


def interpolate(stamps: IntArray, poses: Pose, at: IntArray, longest_gap: int) -> tuple[Pose, BoolArray]:
    """Poses at the stamps `at` (m,) from samples (n,) at rising `stamps` [ticks], and which of them (m,) are good.

    Good are those inside the span of the samples, at a sample or between two that are at most `longest_gap` apart; the
    others are returned as the nearest sample. Law: at a sample's stamp the sample itself comes back.
    """
    if len(stamps) == 0:
        return Pose.identity(poses.dim, at.shape), np.zeros(at.shape, bool)
    right = np.clip(np.searchsorted(stamps, at), 0, len(stamps) - 1)
    left = np.where(stamps[right] == at, right, np.maximum(right - 1, 0))
    gap = stamps[right] - stamps[left]
    inside = (at >= stamps[0]) & (at <= stamps[-1])
    fraction = np.where(inside & (gap > 0), (at - stamps[left]) / np.maximum(gap, 1), 0.0)
    before, after = poses[left], poses[right]
    return before.retract(fraction[..., None] * after.minus(before)), inside & (gap <= longest_gap)


def on_a_smooth_way(stamps: IntArray, poses: Pose, at: IntArray, longest_gap: int) -> tuple[Pose, BoolArray]:
    """The same as `interpolate`, of what moves smoothly: on a cubic through the two samples before and the two after;
    straight where one of these is missing or farther than `longest_gap` away, or turned by more than TURNED.

    Law: exact where place and angle are polynomials of time of the third degree; at a sample's stamp the sample.
    """
    straight, good = interpolate(stamps, poses, at, longest_gap)
    if len(stamps) < 4:
        return straight, good
    k = np.clip(np.searchsorted(stamps, at, "right") - 1, 1, len(stamps) - 3)
    four = k[:, None] + np.arange(-1, 3)
    t = (stamps[four] - at[:, None]).astype(float)
    home = poses[k]
    off = poses[four].minus(home[:, None])
    half = off.shape[-1] - poses.dim
    close = (np.diff(stamps[four], axis=1) <= longest_gap).all(1) & (
        np.linalg.norm(off[..., -half:], axis=-1).max(1) < TURNED
    )
    smooth = good & close & (stamps[k] <= at) & (at <= stamps[k + 1])
    others = t[:, None, :] - t[:, :, None] + np.eye(4)
    shares = np.where(np.eye(4, dtype=bool), 1.0, t[:, None, :] / others).prod(-1)
    found = home.retract(np.einsum("mk,mki->mi", shares, off))
    choose = smooth[:, None]
    translation = np.where(choose, found.translation, straight.translation)
    return Pose(np.where(choose[..., None], found.rotation, straight.rotation), translation), good
