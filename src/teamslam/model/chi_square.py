"""Chi-square: how large sums of squares of unit Gaussians are.

By scipy.special: to import scipy.stats takes longer than to map a small team.
"""

from typing import overload

import numpy as np

from teamslam.geometry import AnyArray, Array


@overload
def chi2_quantile(share: float, dof: int) -> float: ...
@overload
def chi2_quantile(share: float, dof: AnyArray) -> Array: ...
def chi2_quantile(share: float, dof: int | AnyArray) -> float | Array:
    """What a sum of `dof` squares stays below with probability `share`; any batch of `dof` above 0."""
    from scipy.special import gammaincinv

    if np.ndim(dof) == 0:
        return float(2.0 * gammaincinv(0.5 * np.asarray(dof), share))
    different, which = np.unique(dof, return_inverse=True)  # rows measure few different counts of numbers
    return np.asarray((2.0 * gammaincinv(0.5 * different, share))[which]).reshape(np.shape(dof))


def region_of(covariance: Array, confidence: float) -> tuple[Array, Array]:
    """Radii (..., d), rising, and axes (..., d, d), in columns, of the region that holds a Gaussian of `covariance`
    (..., d, d) with `confidence`."""
    values, vectors = np.linalg.eigh(covariance)
    return np.sqrt(np.maximum(values, 0.0) * chi2_quantile(confidence, covariance.shape[-1])), vectors
