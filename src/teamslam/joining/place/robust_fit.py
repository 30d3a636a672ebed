"""The frame of one outline in another: a rigid fit over all that they share, in which wrong links are outvoted.

Each shared pose, and each pair (in space: triple) of shared points, proposes a frame; with the least-squares fit over
everything they stand for election. Each shared thing, at distance d from where a frame puts it, speaks against it by

    log(1 + d^2) ,    d^2 = |dp|^2 / s_p^2 + |dw|^2 / s_w^2        (Cauchy: what is wrong anyway costs little more)

and the frame with the least against it wins. It is then refined by least squares with Cauchy weights until these
settle. How firmly the frame is held is measured: the least information on its rotation [rad^-2].
"""

import itertools
from dataclasses import dataclass, fields

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, align, concatenate, rotations
from teamslam.joining.place.outline import Outline

HINGE = 16.0  # [rad^-2]: below this points leave a frame free to turn; its sigma would be a quarter of a radian
PLACE_SIGMA, TURN_SIGMA = 0.05, 0.02  # [m], [rad]: how far outlines may always be off: they leave out correlations
OUTVOTED = 6.0  # [typical misfits]: what is farther off does not count at all
VOTERS = 128  # shared things that vote on the frames proposed at most; the frame that wins is refined with all of them
PROPOSALS = 64  # frames tried at most of each kind; with 2 of 10 points wrong, half of all triples are right


@dataclass(frozen=True, eq=False)
class Link:
    """How a outline hangs on another: its `frame` there, the `firmness` of its rotation [rad^-2], the keys that they
    share, how much each counts (n,) (1: agrees, 0: outvoted), and whether an orientation that counts is among them."""

    frame: Pose
    firmness: float
    shared: IntArray
    trust: Array
    oriented: bool

    @property
    def holds(self) -> bool:
        """Whether the frame is fixed: one shared pose does, or points at different places."""
        return self.oriented or self.firmness >= HINGE


@dataclass(frozen=True, eq=False)
class _Shared:
    """What two outlines share: places in both, `turns` (n, d, d) from how it stands in one to how in the other, and the
    variances of their differences."""

    source: Array
    target: Array
    variances: Array
    oriented: BoolArray
    turns: Array
    turn_variances: Array

    def spread(self, count: int) -> "_Shared":
        """So many of them at most, evenly over all."""
        n = len(self.source)
        rows = np.unique(np.linspace(0, n - 1, min(n, count)).astype(int))
        return _Shared(*(getattr(self, field.name)[rows] for field in fields(self)))

    def misfit(self, frames: Pose) -> Array:
        """d^2 of every shared thing under each of some frames: (frames, things)."""
        moved = frames[:, None].act(self.source[None])
        squared = np.sum((moved - self.target) ** 2, -1) / self.variances
        back = np.swapaxes(frames.rotation[:, None], -1, -2)
        angle2 = np.sum(rotations(frames.dim).log(back @ self.turns[self.oriented]) ** 2, -1)
        squared[:, self.oriented] += angle2 / self.turn_variances[self.oriented]
        return np.asarray(squared)

    def fit(self, trust: Array) -> Pose:
        """The least-squares frame with everything weighed by its information and by how far it is trusted."""
        return align(
            self.source,
            self.target,
            trust / self.variances,
            source_rotations=np.broadcast_to(np.eye(self.source.shape[1]), self.turns[self.oriented].shape),
            target_rotations=self.turns[self.oriented],
            # |R - R'|_F^2 is twice the squared angle.
            rotation_weights=0.5 * (trust / self.turn_variances)[self.oriented],
        ).pose


def link(cluster: Outline, chain: Outline, planar: bool) -> Link:
    """The best frame of a chain in a cluster's, by all that they share. Law: a shared pose free of noise, or enough
    shared points, give the frame exactly, also beside fewer wrong ones."""
    keys, mine, theirs = np.intersect1d(cluster.keys, chain.keys, assume_unique=True, return_indices=True)
    # What a map knows only to more than numbers hold ties nothing.
    known = np.isfinite(chain.variances[theirs] + cluster.variances[mine])
    known &= np.isfinite(chain.places[theirs] + cluster.places[mine]).all(1)
    keys, mine, theirs = keys[known], mine[known], theirs[known]
    dim = 2 if planar else 3
    if not len(keys):
        return Link(Pose.identity(dim), 0.0, keys, np.zeros(0), False)
    shared = _Shared(
        chain.places[theirs][:, :dim],
        cluster.places[mine][:, :dim],
        chain.variances[theirs] + cluster.variances[mine] + PLACE_SIGMA**2,
        chain.oriented[theirs] & cluster.oriented[mine],
        # Of what is tilted in both, such as a tag on a wall, the turn from one to the other is one of the ground.
        Pose(cluster.turns[mine] @ np.swapaxes(chain.turns[theirs], -1, -2), cluster.places[mine]).onto(dim).rotation,
        chain.turn_variances[theirs] + cluster.turn_variances[mine] + TURN_SIGMA**2,
    )
    found = _settle(keys, shared, _elect(shared, concatenate([_by_all(shared), _by_poses(shared), _by_points(shared)])))
    if not found.holds and shared.oriented.any():
        # Points that do not hold a frame themselves cannot outvote a pose that does.
        return _settle(keys, shared, _elect(shared, _by_poses(shared)), rounds=0)
    return found


def _elect(shared: _Shared, proposals: Pose) -> Pose:
    """The proposed frame with the least against it."""
    against = np.log1p(shared.spread(VOTERS).misfit(proposals)).sum(-1)
    return proposals[int(np.argmin(against))]


def _by_all(shared: _Shared) -> Pose:
    return shared.fit(np.ones(len(shared.source)))[None]


def _by_poses(shared: _Shared) -> Pose:
    poses = np.flatnonzero(shared.oriented)
    poses = poses[np.unique(np.linspace(0, len(poses) - 1, PROPOSALS).astype(int))] if len(poses) else poses
    turn = shared.turns[poses]
    return Pose(turn, shared.target[poses] - (turn @ shared.source[poses][..., None])[..., 0])


def _by_points(shared: _Shared) -> Pose:
    n, dim = shared.source.shape
    # With fewer points there is nobody to outvote.
    return _fits(shared.source, shared.target, _subsets(n, dim)) if n > dim else Pose.identity(dim, (0,))


def _subsets(n: int, size: int) -> IntArray:
    """Pairs or triples of n things: all, or a fixed sample of them."""
    if n <= 8:
        return np.array(list(itertools.combinations(range(n), size)))
    drawn = np.sort(np.random.default_rng(n).integers(n, size=(4 * PROPOSALS, size)), -1)
    return drawn[(np.diff(drawn) > 0).all(-1)][:PROPOSALS]


def _fits(source: Array, target: Array, subsets: IntArray) -> Pose:
    """The rigid fit of every subset of points (Kabsch, as `align`, in a batch)."""
    p, q = target[subsets], source[subsets]
    p_mean, q_mean = p.mean(1, keepdims=True), q.mean(1, keepdims=True)
    u, _, vt = np.linalg.svd(np.swapaxes(p - p_mean, -1, -2) @ (q - q_mean))
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[:, None]
    turn = u @ vt
    return Pose(turn, p_mean[:, 0] - (turn @ np.swapaxes(q_mean, -1, -2))[..., 0])


def _settle(keys: IntArray, shared: _Shared, frame: Pose, rounds: int = 20) -> Link:
    """The frame refined; how far each shared thing is trusted, and the typical misfit (1 where the noise is as
    stated): drift that everything shows is forgiven, a wrong link among good ones is not."""
    trust, scale = _trust(shared, frame)
    for _ in range(rounds):
        frame = shared.fit(trust)
        before, (trust, scale) = trust, _trust(shared, frame)
        if np.allclose(trust, before, rtol=1e-3):
            break
    oriented = bool((shared.oriented & (trust > 0.5)).any())
    return Link(frame, _firmness(shared, trust / scale), keys, trust, oriented)


def _trust(shared: _Shared, frame: Pose) -> tuple[Array, float]:
    squared = shared.misfit(frame[None])[0]
    scale = float(np.maximum(np.median(squared), 1.0))
    return np.where(squared <= OUTVOTED**2 * scale, 1.0 / (1.0 + squared / (4.0 * scale)), 0.0), scale


def _firmness(shared: _Shared, trust: Array) -> float:
    """The least information on the rotation of a frame that is held at these things [rad^-2]."""
    weights = trust / shared.variances
    arms = shared.target - (weights @ shared.target) / weights.sum()
    moment = (weights[:, None] * arms).T @ arms
    inertia = np.trace(moment) * np.eye(len(moment)) - moment
    held = float(np.trace(moment)) if len(moment) == 2 else float(np.linalg.eigvalsh(inertia)[0])
    # Points at one place seem apart by their noise: about 1 for each.
    held = max(held - (len(arms) - 1), 0.0)
    return held + float((trust / shared.turn_variances)[shared.oriented].sum())
