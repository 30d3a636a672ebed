"""Where the second of two neighbouring stretches lies in the first: at its end, corrected by the landmarks both saw.

For many pairs at once, by iteratively reweighted Gauss-Newton from what the way says, X_0:

    min over X   sum_k rho(|X q_k - p_k|^2 / s_k^2)  +  rho(|t - t_0|^2 / S_T^2 + |Log(R_0' R)|^2 / S_R^2) ,

rho(u) = 4 log(1 + u / 4), Cauchy's: a landmark that is another one than thought is outvoted, and so is a way that
slipped. What every landmark of a pair shows, its median misfit, is drift and is forgiven.
"""

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, rotations

STEPS = 12
OUTVOTED = 6.0  # [typical misfits]: what is farther off does not count at all
SEAM_SIGMA = (0.2, 0.3)  # [m], [rad]: how far the end of a stretch may be off


def corrected(seams: Pose, source: Array, target: Array, variances: Array, pair: IntArray) -> Pose:
    """The frames (n,) of the second of each pair in the first.

    `seams` (n,): where the ways say. Landmarks in both: `source` (m, d) in the second, `target` (m, d) in the first,
    `variances` (m,) [m^2] of their difference, and which `pair` (m,) they belong to. Law: seams without landmarks stay.
    """
    d, n = seams.dim, len(seams)
    group = rotations(d)
    dof = d + group.DOF
    prior = np.repeat(1.0 / np.square(SEAM_SIGMA), [d, group.DOF])
    frames = seams
    for _ in range(STEPS):
        arms = (frames.rotation[pair] @ source[..., None])[..., 0]
        missing = target - arms - frames.translation[pair]
        weights = _trust(np.sum(missing**2, -1) / variances, pair, n) / variances
        turned = [(arms @ group.hat(axis).T)[..., None] for axis in np.eye(group.DOF)]
        jacobian = np.concatenate([np.broadcast_to(np.eye(d), (len(pair), d, d)), *turned], -1)
        weighted = weights[:, None, None] * np.swapaxes(jacobian, -1, -2)
        information, gradient = np.zeros((n, dof, dof)), np.zeros((n, dof))
        np.add.at(information, pair, weighted @ jacobian)
        np.add.at(gradient, pair, (weighted @ missing[..., None])[..., 0])
        # The turn back to the seam, written in the first's frame as the unknowns are.
        turn = group.log(seams.rotation @ np.swapaxes(frames.rotation, -1, -2))
        back = np.concatenate([seams.translation - frames.translation, turn], -1)
        pull = prior / (1.0 + np.sum(prior * back**2, -1, keepdims=True) / 4.0)
        information[:, np.arange(dof), np.arange(dof)] += pull
        step = np.linalg.solve(information, (gradient + pull * back)[..., None])[..., 0]
        frames = Pose(group.exp(step[:, d:]) @ frames.rotation, frames.translation + step[:, :d])
        if np.abs(step).max(initial=0.0) < 1e-3:
            break
    return frames


def _trust(squared: Array, pair: IntArray, n: int) -> Array:
    """How far each landmark is trusted, against the typical misfit of its pair."""
    order = np.lexsort([squared, pair])
    count = np.bincount(pair, minlength=n)
    typical = np.ones(n)
    has = np.flatnonzero(count)
    typical[has] = np.maximum(squared[order[(np.cumsum(count) - count + count // 2)[has]]], 1.0)
    relative = squared / typical[pair]
    return np.where(relative <= OUTVOTED**2, 1.0 / (1.0 + relative / 4.0), 0.0) / typical[pair]
