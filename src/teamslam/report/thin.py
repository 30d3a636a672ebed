"""As much of a run as an eye can tell apart, so that a page of a long run is no heavier than it need be."""

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray


def within(places: Array, step_m: float) -> IntArray:
    """Poses (k,) of a way (n, 3) that hold it: the first, the last, and each that begins another `step_m` along it.

    Law: no pose is further than `step_m` from the one that stands for it.
    """
    if step_m <= 0.0 or len(places) < 3:
        return np.arange(len(places))
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=-1))])
    begins = np.diff(np.floor(along / step_m), prepend=-1.0) > 0.0
    begins[-1] = True
    return np.flatnonzero(begins)


def evenly(size: Array, most: int) -> BoolArray:
    """About `most` of rows (n,): every so many-th, and the twentieth part of them that is largest."""
    kept = np.ones(len(size), bool)
    if len(size) <= most:
        return kept
    kept[:] = False
    kept[:: -(-len(size) // most)] = True
    worst = max(most // 20, 1)
    kept[np.argpartition(size, -worst)[-worst:]] = True
    return kept
