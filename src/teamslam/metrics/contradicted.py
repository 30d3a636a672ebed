"""Which landmarks the truth has elsewhere than all others say: a survey is written by hand, and tags are moved after.

The map is moved onto the truth so that most landmarks agree (by a loss that forgives), and what is left of each is held
against what it may be by chance: what the map says of itself after such a motion, and a spread s that truth and map
have beside it, as large as the middle one of all landmarks needs.

    d = landmark - truth,   d' (P + s^2 1)^-1 d  >  chi-square's quantile, 1 - ALARMS / n

P = A C A', C the covariance of all n landmarks, A = 1 - G (G'WG)^-1 G'W what is left of errors when the whole is moved
onto those that agree (W), G how places move with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.errors import in_words
from teamslam.geometry import Array, IntArray, align, rotations
from teamslam.metrics.consistency import Marginals
from teamslam.metrics.frames import Aligned
from teamslam.model import Names, chi2_quantile, index_of, is_landmark

ALARMS = 0.01  # honest maps in which any landmark is named
LEAST, MOST = 6, 250  # landmarks: below, nobody knows who is wrong; above, their joint covariance is no small matter
ROUNDS = 30
MOST_TOLD = 5  # one by one in words


@dataclass(frozen=True)
class Contradiction:
    """A landmark that the truth has `off_m` from where the map has it, where the others agree to `others_m` [m]. Of a
    team in the plane these are distances `seen_from_above`, whatever heights its landmarks have."""

    landmark: str
    off_m: float
    others_m: float
    seen_from_above: bool = False


def contradicted(aligned: Aligned, covariances: Marginals | None, names: Names) -> tuple[Contradiction, ...]:
    """Landmarks that map and truth have at different places, the worst first; none where too few are known to both, or
    where most are. In space those count of which the truth has the height, too.

    Law: moving the truth as a whole changes nothing; which of the two is wrong, nobody can say from these alone.
    """
    dim, truth = aligned.pose.dim, aligned.truth.layout
    keys = aligned.keys[is_landmark(aligned.keys)]
    keys = keys if dim == 2 else keys[truth.kinds[truth.index(keys)] % 2 == 1]
    if covariances is None or not LEAST <= len(keys) <= MOST:
        return ()
    here, there = aligned.estimate.positions(keys, dim), aligned.truth.positions(keys, dim)
    places, C = aligned.pose.unact(here), _places(covariances.joint(keys), keys, aligned, dim)
    half, limit = chi2_quantile(0.5, dim), chi2_quantile(1.0 - ALARMS / len(keys), dim)
    weights, far = _agreed(here, there), np.zeros(len(keys), bool)
    for _ in range(ROUNDS):
        moved = align(here, there, weights).pose
        off, turn = moved.act(here) - there, (moved @ aligned.pose).rotation
        own = turn @ _left(C, places, weights) @ turn.T
        before, far = far, _squares(off, own + _spread(off, own, half) ** 2 * np.eye(dim)) > limit
        weights = np.where(far, 0.0, 1.0)
        if (before == far).all() or 2 * np.count_nonzero(far) >= len(keys):
            break
    if 2 * np.count_nonzero(far) >= len(keys):
        return ()
    lengths = np.linalg.norm(off, axis=1)
    rest = float(np.sqrt(np.mean(lengths[~far] ** 2)))
    worst = np.flatnonzero(far)[np.argsort(-lengths[far], kind="stable")]
    flat = dim == 2 and bool((layout := aligned.estimate.layout).kinds[layout.index(keys)].max() % 2)
    called = [names.landmark(int(index_of(keys[k]))) for k in worst.tolist()]
    return tuple(Contradiction(name, float(lengths[k]), rest, flat) for name, k in zip(called, worst, strict=True))


def told_of(contradictions: Sequence[Contradiction]) -> str:
    """Landmarks at which truth and map disagree, in words."""
    some = ", ".join(f"{in_words(found.landmark)} ({found.off_m:.2f} m)" for found in contradictions[:MOST_TOLD])
    more = f" and {len(contradictions) - MOST_TOLD} more" if len(contradictions) > MOST_TOLD else ""
    worst = contradictions[0]
    above = ", seen from above" if worst.seen_from_above else ""
    return f"at {some}{more}; at the others to {worst.others_m:.2g} m{above}: which of the two is wrong, look there"


def _agreed(here: Array, there: Array) -> Array:
    """Weights (n,) by which most places come where they truly are: Cauchy's loss, its scale that of the middle one."""
    weights = np.ones(len(here))
    for _ in range(ROUNDS):
        moved = align(here, there, weights).pose
        off = np.linalg.norm(moved.act(here) - there, axis=1)
        scale = np.median(off)
        if scale <= 1e-12:
            break
        weights = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2)
    return np.asarray(weights)


def _places(C: Array, keys: IntArray, aligned: Aligned, dim: int) -> Array:
    """The joint covariance of the places (n dim, n dim) of landmarks that may be poses."""
    layout = aligned.estimate.layout
    dofs = layout.dofs[layout.index(keys)]
    starts = np.concatenate([[0], np.cumsum(dofs)[:-1]])
    rows = (starts[:, None] + np.arange(dim)).ravel()
    return np.asarray(C[np.ix_(rows, rows)])


def _left(C: Array, places: Array, weights: Array) -> Array:
    """The covariance (n, dim, dim) of each of n places when the whole has been moved by least squares with weights."""
    n, dim = places.shape
    about = places - places.mean(0)
    turns = rotations(dim).hat(np.eye(1 if dim == 2 else 3))
    G = np.concatenate([np.tile(np.eye(dim), (n, 1)), *((about @ t.T).reshape(-1, 1) for t in turns)], 1)
    GW = G.T * np.repeat(weights, dim)
    A = np.eye(n * dim) - G @ np.linalg.solve(GW @ G, GW)
    P = (A @ C @ A.T).reshape(n, dim, n, dim)
    return np.asarray(P[np.arange(n), :, np.arange(n), :])


def _spread(off: Array, own: Array, half: float) -> float:
    """The spread s with which the middle landmark is as far off as half are by chance; 0 where its own is enough."""
    low, high = 0.0, float(np.median(np.linalg.norm(off, axis=1)))
    unit = np.eye(off.shape[1])
    floor = 1e-12 * max(high, 1e-300) ** 2
    if np.median(_squares(off, own + floor * unit)) <= half:
        return 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.median(_squares(off, own + middle**2 * unit)) > half else (low, middle)
    return high


def _squares(off: Array, covariance: Array) -> Array:
    """Distances off (n, d) by their covariances (n, d, d), squared; those known to rounding, by that rounding."""
    least = 1e-12 * np.trace(covariance, axis1=-2, axis2=-1) + 1e-200
    firm = covariance + least[:, None, None] * np.eye(off.shape[1])
    return np.asarray(np.sum(off * np.linalg.solve(firm, off[..., None])[..., 0], -1))
