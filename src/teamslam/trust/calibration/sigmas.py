"""What a map's sigmas come from: noise as stated, noise put right, and systematic errors that stay uncertain."""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import Kind, is_landmark, is_pose
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
    size = np.where(free.kinds == Kind.POSE2, 2, np.where(free.kinds == Kind.POINT2, 2, 3))
    stated, noise = (_squares(factor.marginals(), size) for factor in (fit.linear.at.gap.factor, fit.factor))
    followed = fit.pulled.followed[:, fit.choice.inside]
    each = np.sum((followed @ fit.covariance) * followed, 1) if followed.shape[1] else np.zeros(free.dof)
    more = np.array([each[s : s + n].mean() for s, n in zip(free.dof_start[:-1].tolist(), size.tolist(), strict=True)])
    kinds: dict[str, BoolArray] = {"landmarks": is_landmark(free.keys), "robots": is_pose(free.keys)}
    return [
        Sigmas(what, *(float(np.sqrt(np.median(part[mine]))) for part in (stated, noise, noise + more)))
        for what, mine in kinds.items()
        if mine.any()
    ]


def _squares(marginals: list[Array], size: Array) -> Array:
    """The mean variance of each variable's coordinates (n,)."""
    return np.array([np.diag(block)[:n].mean() for block, n in zip(marginals, size.tolist(), strict=True)])
