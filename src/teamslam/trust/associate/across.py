"""Which landmarks of two maps are the same, though nobody knows how the maps lie to each other: constellations.

A pair (i, j) says that landmark i of one map is j of the other. Two pairs agree where the distances within each map do,
to their uncertainty,

    |d_ii' - d_jj'| <= gate * sqrt(var d_ii' + var d_jj')

and a set of pairs of which every two agree is a clique. A clique fixes a rigid motion (a mirror image is refused by its
fit), by which all pairs are judged again. Each pair that fits makes the motion more likely than chance by what it would
be were it of strangers: -1/2 e'S^-1 e - 1/2 log |2 pi S| + log(area). Motions that are not the same are rivals, and
their odds are told; that the maps have nothing in common is one of them.
Source: Bailey, Nebot, Rosenblatt, Durrant-Whyte, "Data Association for Mobile Robot Navigation: A Graph Theoretic
Approach" (ICRA 2000).
"""

from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, align
from teamslam.model import Submap, chi2_quantile
from teamslam.solver import Covariances
from teamslam.trust.outliers.clique import largest_clique

GATE = 0.999
RIVALS = 6  # motions that are compared
FEWEST = 3  # pairs that a motion needs
SCALES = (1.0, 2.0, 3.0)  # times the stated errors that maps may have: on real logs they are too sure of themselves
STEPS = 5_000  # of the search for a clique
PRIOR = np.log(1e6)  # against a motion that nothing but the constellations speaks for


@dataclass(frozen=True, eq=False)
class Constellation:
    """What a map knows of its landmarks: their `keys` (n,), `labels` (n,) or -1, `places` (n, d) and the covariance of
    all places together (n, d, n, d). Maps of robots in the plane (`frame_dim` 2) lie to each other by motions of the
    plane."""

    keys: IntArray
    labels: IntArray
    places: Array
    covariance: Array
    frame_dim: int

    @classmethod
    def of(cls, map: Submap, labels: dict[int, int]) -> "Constellation":
        """Of a map's landmarks; `labels` by key."""
        keys = map.landmark_keys
        layout = map.values.layout
        dim = 2 + int((layout.kinds[layout.index(keys)] % 2).max(initial=0))
        joint = Covariances.of_map(map).joint(keys)
        dofs = layout.dofs[layout.index(keys)]
        starts = np.cumsum(dofs) - dofs
        rows = (starts[:, None] + np.arange(dim)).ravel()
        covariance = joint[np.ix_(rows, rows)].reshape(len(keys), dim, len(keys), dim)
        named = np.array([labels.get(int(key), -1) for key in keys], np.int64)
        return cls(keys, named, map.values.positions(keys, dim), covariance, map.base_dim)

    def distances(self) -> tuple[Array, Array]:
        """Between all landmarks (n, n) [m], and their variances."""
        off = self.places[:, None] - self.places[None]
        distance = np.linalg.norm(off, axis=-1)
        along = off / np.where(distance > 0.0, distance, 1.0)[..., None]
        n = np.arange(len(self.keys))
        own = self.covariance[n, :, n, :]
        mixed = np.swapaxes(self.covariance, 1, 2)
        both = own[:, None] + own[None] - mixed - np.swapaxes(mixed, 2, 3)
        return distance, np.einsum("ijk,ijkl,ijl->ij", along, both, along)

    def own(self) -> Array:
        """The covariance of each place (n, d, d)."""
        n = np.arange(len(self.keys))
        return self.covariance[n, :, n, :]


@dataclass(frozen=True, eq=False)
class Motion:
    """One way in which two maps may lie: `pose` of the second in the first, `pairs` (k, 2) of keys that are the same,
    how much more likely than chance it is (`evidence`, natural log), how many times larger than stated the maps' errors
    look in it (`scale`), and its `odds` among all ways (0 to 1)."""

    pose: Pose
    pairs: IntArray
    evidence: float
    scale: float
    odds: float = 0.0


def motions(one: Constellation, other: Constellation, known: Pose | None = None) -> list[Motion]:
    """The ways in which two maps may lie to each other, the likeliest first; empty where nothing speaks for any.

    `known`: how the second lies in the first as something else tells, such as robots that saw each other.
    """
    agree, pairs = _agreement(one, other)
    left, found = np.ones(len(pairs), bool), []
    if known is not None and (motion := _fitted(one, other, known.lift(one.places.shape[1]), PRIOR)) is not None:
        found.append(motion)
        left &= ~_explained(one, other, motion, pairs)
    while len(found) < RIVALS and left.sum() >= FEWEST:
        where = np.flatnonzero(left)
        clique = where[largest_clique(agree[np.ix_(where, where)], steps=STEPS).members]
        if len(clique) < FEWEST:
            break
        left[clique] = False
        motion = _fitted(one, other, _aligned(one, other, pairs[clique]), 0.0)
        if motion is not None:
            # What this motion explains can speak for no rival that is a slight variation of it.
            left &= ~_explained(one, other, motion, pairs)
            if not any(_same(motion, earlier) for earlier in found):
                found.append(motion)
    return _with_odds(found)


def _same(one: Motion, other: Motion) -> bool:
    """Whether two motions match mostly the same."""
    common = {tuple(pair) for pair in one.pairs.tolist()} & {tuple(pair) for pair in other.pairs.tolist()}
    return 2 * len(common) > min(len(one.pairs), len(other.pairs))


def _agreement(one: Constellation, other: Constellation) -> tuple[BoolArray, IntArray]:
    """Which pairs (n, n) of pairs (n, 2) of places agree."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(len(one.keys)), np.arange(len(other.keys)), indexing="ij"))
    mine, theirs = one.labels[i], other.labels[j]
    shared = np.intersect1d(one.labels[one.labels >= 0], other.labels[other.labels >= 0])
    may = np.where((mine >= 0) & (theirs >= 0), mine == theirs, ~np.isin(mine, shared) & ~np.isin(theirs, shared))
    i, j = i[may], j[may]
    d1, v1 = one.distances()
    d2, v2 = other.distances()
    apart = np.abs(d1[np.ix_(i, i)] - d2[np.ix_(j, j)])
    limit = SCALES[-1] * np.sqrt(chi2_quantile(GATE, 1) * (v1[np.ix_(i, i)] + v2[np.ix_(j, j)]))
    different = (i[:, None] != i[None]) & (j[:, None] != j[None])
    return np.asarray((apart <= limit) & different), np.stack([i, j], -1)


def _fitted(one: Constellation, other: Constellation, pose: Pose, prior: float) -> Motion | None:
    """The motion that all pairs near `pose` fit, with errors as large as makes it likeliest; None where too few do."""
    best: Motion | None = None
    for scale in SCALES:
        at = pose
        for _ in range(4):
            matched, _ = _matched(one, other, at, scale)
            if len(matched) < FEWEST:
                break
            at = _aligned(one, other, matched)
        matched, evidence = _matched(one, other, at, scale)
        if len(matched) < FEWEST:
            continue
        # A motion that fits anything must be bought: as many pairs as fix it say nothing.
        d, free = one.places.shape[1], Pose.identity(min(one.frame_dim, other.frame_dim)).dof
        worth = evidence * max(1.0 - free / (d * len(matched)), 0.0) + prior
        if best is None or worth > best.evidence:
            keys = np.stack([one.keys[matched[:, 0]], other.keys[matched[:, 1]]], -1)
            best = Motion(at, keys, worth, scale)
    return best


def _aligned(one: Constellation, other: Constellation, pairs: IntArray) -> Pose:
    """The motion between matched places that their frames allow."""
    d = min(one.frame_dim, other.frame_dim)
    source, target = other.places[pairs[:, 1]], one.places[pairs[:, 0]]
    return align(source[:, :d], target[:, :d]).pose.lift(source.shape[1])


def _matched(one: Constellation, other: Constellation, pose: Pose, scale: float) -> tuple[IntArray, float]:
    """The pairs that fit a motion, each landmark once, such that they speak for it most, and how much."""
    from scipy.optimize import linear_sum_assignment

    distance, gain = _fits(one, other, pose, scale)
    worth = np.where(distance <= chi2_quantile(GATE, pose.dim), np.maximum(gain, 0.0), 0.0)
    i, j = linear_sum_assignment(-worth)
    kept = worth[i, j] > 0.0
    return np.stack([i[kept], j[kept]], -1), float(worth[i[kept], j[kept]].sum())


def _fits(one: Constellation, other: Constellation, pose: Pose, scale: float) -> tuple[Array, Array]:
    """For all pairs (n, m): how far they are off a motion (squared sigmas), and by how much they speak for it."""
    moved, turn = pose.act(other.places), pose.rotation
    S = scale**2 * (one.own()[:, None] + (turn @ other.own() @ turn.T)[None])
    off = one.places[:, None] - moved[None]
    distance = np.sum(off * np.linalg.solve(S, off[..., None])[..., 0], -1)
    area = np.prod(np.maximum(np.ptp(one.places, axis=0), 1e-9)) / len(one.keys)
    gain = np.log(area) - 0.5 * distance - 0.5 * np.linalg.slogdet(2.0 * np.pi * S)[1]
    named = (one.labels[:, None] >= 0) & (other.labels[None] >= 0)
    same = one.labels[:, None] == other.labels[None]
    distance = np.where(named & ~same, np.inf, distance)
    return distance, gain + np.where(named & same, PRIOR, 0.0)


def _explained(one: Constellation, other: Constellation, motion: Motion, pairs: IntArray) -> BoolArray:
    distance, _ = _fits(one, other, motion.pose, motion.scale)
    return np.asarray(distance[pairs[:, 0], pairs[:, 1]] <= chi2_quantile(GATE, motion.pose.dim))


def _with_odds(found: list[Motion]) -> list[Motion]:
    """Each motion with its odds, against its rivals and against there being nothing in common."""
    if not found:
        return []
    scores = np.array([*(motion.evidence - PRIOR for motion in found), 0.0])
    weights = np.exp(scores - scores.max())
    odds = weights / weights.sum()
    made = [replace(motion, odds=float(share)) for motion, share in zip(found, odds[:-1], strict=True)]
    return sorted(made, key=lambda motion: -motion.odds)
