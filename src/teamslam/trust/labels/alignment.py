"""How well a constellation fits on a map, under many assumptions on which landmark is which, all at once.

    min over X of  r'(C + R P R')^-1 r,      r = q_id - X p

p: n places in the constellation's frame with covariance P; q: those of the map, C; id: an assumption. A rigid fit in
closed form for every assumption (weights: one a landmark), then Gauss and Newton with the whole covariances for those
that fit best.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Submap
from teamslam.solver import Covariances
from teamslam.trust.evidence import Fit

STEPS = 4  # of Gauss and Newton
STEP = 1e-6  # of a numerical derivative [m], [rad]


@dataclass(frozen=True, eq=False)
class Stars:
    """Landmarks of one map: `keys` (n,), `places` (n, d), and the covariance of all together (n, d, n, d)."""

    keys: IntArray
    places: Array
    covariance: Array

    @classmethod
    def of(cls, constellation: Submap, dim: int) -> "Stars":
        """The landmarks of a constellation, in space of `dim`."""
        keys, layout = constellation.landmark_keys, constellation.values.layout
        joint = Covariances.of_map(constellation).joint(layout.keys)
        covariance = np.zeros((len(keys), dim, len(keys), dim))
        first = layout.dof_start[layout.index(keys)]
        axes = np.minimum(dim, np.array([2, 3])[layout.kinds[layout.index(keys)] % 2])
        for row, (a, m) in enumerate(zip(first.tolist(), axes.tolist(), strict=True)):
            for column, (b, n) in enumerate(zip(first.tolist(), axes.tolist(), strict=True)):
                covariance[row, :m, column, :n] = joint[a : a + m, b : b + n]
        return cls(keys, constellation.values.positions(keys, dim), covariance)

    @property
    def variances(self) -> Array:
        """The mean variance of each landmark's coordinates (n,)."""
        n = np.arange(len(self.keys))
        return np.asarray(np.trace(self.covariance[n, :, n, :], axis1=-2, axis2=-1) / self.places.shape[-1])


def roughly(stars: Stars, sky: Stars, assumed: IntArray, dim: int) -> tuple[Array, Pose]:
    """The weighted misfit (m,) and the frame of a constellation on a map in closed form, under assumptions (m, n):
    the place in `sky` of each of the `stars`, -1 for none. `dim` of the frame."""
    known = assumed >= 0
    there = np.where(known, assumed, 0)
    weights = known / (stars.variances + sky.variances[there])
    p, q = np.broadcast_to(stars.places, (*assumed.shape, stars.places.shape[-1])), sky.places[there]
    share = weights / np.maximum(weights.sum(-1, keepdims=True), 1e-300)
    p_mean, q_mean = ((share[..., None] * x).sum(-2)[:, None] for x in (p, q))
    flat_p, flat_q = (p - p_mean)[..., :dim], (q - q_mean)[..., :dim]
    u, _, vt = np.linalg.svd(np.swapaxes(share[..., None] * flat_q, -1, -2) @ flat_p)
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[:, None]
    turn = u @ vt
    frames = Pose(turn, q_mean[:, 0, :dim] - (turn @ p_mean[:, 0, :dim, None])[..., 0])
    off = q - frames.lift(p.shape[-1])[:, None].act(p)
    return np.asarray((weights * np.sum(off**2, -1)).sum(-1)), frames


def closely(stars: Stars, sky: Stars, assumed: IntArray, frame: Pose) -> Fit:
    """What the best frame near one costs under one assumption (n,), with the whole covariances."""
    mine = np.flatnonzero(assumed >= 0)
    theirs = assumed[mine]
    d = stars.places.shape[-1]
    p, q = stars.places[mine], sky.places[theirs]
    own, others = stars.covariance[mine][:, :, mine], sky.covariance[theirs][:, :, theirs]
    dof = p.size - frame.dof
    if dof < 1:
        return Fit(0.0, 0)
    cost = np.inf
    for _ in range(STEPS):
        turn = frame.lift(d).rotation
        spread = others + np.einsum("ab,ibjc,dc->iajd", turn, own, turn)
        white = np.linalg.inv(np.linalg.cholesky(spread.reshape(p.size, p.size)))
        off = white @ (q - frame.lift(d).act(p)).ravel()
        slope = white @ _slope(frame, p)
        step = np.linalg.lstsq(slope, off, rcond=None)[0]
        cost = float(np.sum((off - slope @ step) ** 2))
        frame = frame.retract(np.array(step, float))
    return Fit(cost, dof)


def _slope(frame: Pose, points: Array) -> Array:
    """How the points (n, d) move with the frame along each of its unknowns (n d, dof), by central differences."""
    steps: Array = np.zeros((frame.dof, frame.dof))
    np.fill_diagonal(steps, STEP)
    d = points.shape[-1]
    ahead, behind = (
        frame[None].retract(np.array(step, float)).lift(d)[:, None].act(points[None]) for step in (steps, -steps)
    )
    return np.asarray((ahead - behind).reshape(frame.dof, -1).T / (2.0 * STEP))
