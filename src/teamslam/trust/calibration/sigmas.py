"""What a map's sigmas come from: noise as stated, noise put right, and systematic errors that stay uncertain."""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import Layout, is_landmark, is_pose
from teamslam.solver import Factor
from teamslam.trust.calibration.posterior import Fit


@dataclass(frozen=True)
class Sigmas:
    """How well the places of `what` are known [m], in the middle: as the noise is `stated`, by the `noise` put right,
    and with what stays uncertain of systematic errors (`whole`)."""

    what: str
    stated: float
    noise: float
    whole: float


def sigmas_of(fit: Fit) -> list[Sigmas]:
    """Those of landmarks and of robots, where a map has any besides its base. Law: noise <= whole."""
    free = fit.linear.at.gap.free
    stated, noise = (_of_places(free, _variances(factor)) for factor in (fit.linear.at.gap.factor, fit.factor))
    more = _of_places(free, np.sum((fit.followed @ fit.covariance) * fit.followed, 1))
    kinds: dict[str, BoolArray] = {"landmarks": is_landmark(free.keys), "robots": is_pose(free.keys)}
    return [
        Sigmas(what, *(float(np.sqrt(np.median(part[mine]))) for part in (stated, noise, noise + more)))
        for what, mine in kinds.items()
        if mine.any()
    ]


def _variances(factor: Factor) -> Array:
    """Of each unknown (dof,)."""
    out, starts = np.zeros(factor.layout.dof), factor.layout.dof_start
    for places, blocks in factor.marginals_by_size():
        out[starts[places, None] + np.arange(blocks.shape[-1])] = np.diagonal(blocks, axis1=1, axis2=2)
    return out


def _of_places(layout: Layout, variances: Array) -> Array:
    """The mean variance of each variable's coordinates (n,)."""
    dims, axis = 2 + layout.kinds % 2, np.arange(3)
    places = np.minimum(layout.dof_start[:-1, None] + axis, layout.dof - 1)
    return np.asarray(np.sum(np.where(axis < dims[:, None], variances[places], 0.0), 1) / dims)
