"""Poses between stamps: translation along the straight line, rotation along the shortest turn.

X(t) = X_a (+) f (X_b (-) X_a),   f = (t - t_a) / (t_b - t_a)      so headings wrap as they should
"""

import numpy as np

from teamslam.geometry import BoolArray, IntArray, Pose


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
