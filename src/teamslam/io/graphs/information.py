"""What a whitening W says of a measurement: its information W'W, and its covariance where it has one.

Information may have directions of zero (a constraint in the plane of something in space, a range written as a point):
they say nothing, W has rows of zeros for them, and there is no covariance.
"""

import numpy as np

from teamslam.geometry import Array
from teamslam.model import ranks, whitening_of_information


def information_of_whitening(whitening: Array) -> Array:
    """W'W, exactly symmetric."""
    information = np.swapaxes(whitening, -1, -2) @ whitening
    return np.asarray(0.5 * (information + np.swapaxes(information, -1, -2)))


def transported(whitening: Array, a: Array) -> Array:
    """The whitening (m, r, r) of a measurement whose errors are those of W times A: lower triangular, of A'W'WA.

    Law: as many directions are measured as before. The information itself, multiplied from both sides, loses them where
    its scales lie far apart: what is small is a difference of what is large."""
    return whitening_of_information(information_of_whitening(whitening @ a))


def has_covariance(whitening: Array) -> bool:
    """True where every row (m, r, r) says something about every direction."""
    return bool((ranks(whitening) == whitening.shape[-1]).all())


def covariance_of_whitening(whitening: Array) -> Array:
    """(W'W)^-1, exactly symmetric."""
    root = np.linalg.inv(whitening)
    covariance = root @ np.swapaxes(root, -1, -2)
    return np.asarray(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
