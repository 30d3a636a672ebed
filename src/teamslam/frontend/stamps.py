"""Stamps that are near enough to be one: groups of instants that share a keyframe."""

import numpy as np

from teamslam.geometry import IntArray


def merge(stamps: IntArray, longest: int) -> IntArray:
    """The keyframes of wanted stamps: the first stamp of each group, groups being at most `longest` ticks long."""
    heads: list[int] = []
    for stamp in np.unique(stamps).tolist():
        if not heads or stamp - heads[-1] > longest:
            heads.append(stamp)
    return np.array(heads, np.int64)


def keyframe_of(keyframes: IntArray, ticks: IntArray) -> IntArray:
    """The keyframe that each wanted stamp belongs to: the last one not after it."""
    return np.asarray(keyframes[np.searchsorted(keyframes, ticks, "right") - 1])
