"""How far a map that is written in the world lies off as a whole: its places without any alignment.

Of fixes that are wrong together (reflected signals, a base station's error) errors after an alignment show nothing, and
NEES of thousands of variables hardly anything: what is wrong is where all of it is. So the mean error e of places is
held against what the map says of it:

    e = 1/n sum (place_k - truth_k),    e' E^-1 e / d,    E = 1/n^2 sum_kl C_kl
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.metrics.consistency import ChiSquare, Marginals
from teamslam.metrics.frames import Aligned, in_another_world
from teamslam.model import WORLD, Submap, chi2_quantile, is_pose

MOST = 60  # places of which the mean is taken, spread evenly over all: their joint covariance is no small matter
CHANCE = 0.001  # of honest maps are as far off, or farther, as what is said not to be by chance


@dataclass(frozen=True)
class InWorld:
    """RMSE [m] of robots' positions and of landmarks where nothing is aligned (None where there are none); the length
    `off_m` of the mean error of places, its standard deviation `sigma_m` as the map states it, and its `nees`."""

    robot_position_rmse_m: float | None
    landmark_rmse_m: float | None
    off_m: float
    sigma_m: float
    nees: ChiSquare


def in_world(map: Submap, aligned: Aligned, covariances: Marginals | None) -> InWorld | None:
    """How far a map is off in the world; None of a map that is written in the frame of a pose or in another world than
    the truth is, or where nobody knows covariances, or where some of its places have fewer numbers than others."""
    dim, keys = aligned.pose.dim, aligned.keys
    layouts = aligned.estimate.layout, aligned.truth.layout
    told = dim == 2 or all(bool((layout.kinds[layout.index(keys)] % 2 == 1).all()) for layout in layouts)
    if map.base != WORLD or in_another_world(map, aligned) or covariances is None or not told:
        return None
    error = map.values.positions(keys, dim) - aligned.truth.positions(keys, dim)
    some = np.unique(np.linspace(0, len(keys) - 1, MOST).round().astype(int))
    mean, C = error[some].mean(0), _of_mean(covariances, keys[some], aligned, dim)
    robots = is_pose(keys)
    return InWorld(
        _rms(error[robots]),
        _rms(error[~robots]),
        float(np.linalg.norm(mean)),
        float(np.sqrt(np.trace(C))),
        ChiSquare(float(mean @ np.linalg.solve(C, mean)), dim),
    )


def said_of(found: InWorld) -> str:
    """The same in words."""
    rms = (("robots", found.robot_position_rmse_m), ("landmarks", found.landmark_rmse_m))
    each = ", ".join(f"{what} {value:.4f} m" for what, value in rms if value is not None)
    by_chance = found.nees.value < chi2_quantile(1.0 - CHANCE, found.nees.dof)
    sure = "as it may be by chance" if by_chance else "which is not by chance"
    return f"{each} without alignment; as a whole {found.off_m:.2g} m off, known to {found.sigma_m:.2g} m, {sure}"


def _rms(errors: Array) -> float | None:
    return float(np.sqrt(np.mean(np.sum(errors**2, -1)))) if len(errors) else None


def _of_mean(covariances: Marginals, keys: IntArray, aligned: Aligned, dim: int) -> Array:
    """The covariance (dim, dim) of the mean of places."""
    layout = aligned.estimate.layout
    starts = np.concatenate([[0], np.cumsum(layout.dofs[layout.index(keys)])[:-1]])
    C = covariances.joint(keys)
    G = np.zeros((dim, len(C)))
    for axis in range(dim):
        G[axis, starts + axis] = 1.0 / len(keys)
    return np.asarray(G @ C @ G.T)
