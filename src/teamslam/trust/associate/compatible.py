"""Which sightings of one image are of which landmarks: joint compatibility.

Each sighting may be of a landmark within its gate, or of none that is known, and no two of one image are of the same.
Of all hypotheses whose residuals are compatible together (chi-square) the most likely counts: residuals of one image
share the error of its pose. Where others are nearly as likely, the sightings in which they differ are left open.
Source: Neira, Tardos, "Data Association in Stochastic Mapping Using the Joint Compatibility Test" (TRA 17(6), 2001).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import chi2_quantile
from teamslam.trust.associate.filter import Innovations

GATE = 0.999  # of what is compatible
OPEN = 2.0 * np.log(100.0)  # -2 log of the odds below which two hypotheses are both held possible
MOST_STEPS = 300
UNLIKELY = 2.0 * np.log(1e4)  # likewise: hypotheses less likely than that are not followed
MISSED = 50.0  # cost of a sighting that is of none of the landmarks, where no new ones are made
NONE, UNSURE, NEW = -1, -2, -3


def gate(rank: IntArray, share: float = GATE) -> Array:
    """The squared distance that `share` of true matches stay below."""
    return np.asarray(chi2_quantile(share, np.maximum(rank, 1)))


@dataclass(frozen=True, eq=False)
class Reading:
    """One way to read an image: for each sighting the pair that it is, NEW, NONE or UNSURE (m,), and its -2 log
    likelihood, but for a constant. `shares`: of each sighting of something known, the pairs that it may be, with how
    likely they are beside the first."""

    pairs: IntArray
    cost: float
    shares: tuple[dict[int, float], ...] = ()


def matched(seen: Innovations, image: IntArray, allowed: BoolArray) -> IntArray:
    """For each sighting of an image (m,) the pair that it is, NONE or UNSURE.

    `seen`: all pairs (k,) of sightings and landmarks; `image` (k,): the sighting of each, 0 .. m - 1; `allowed` (k,):
    pairs that may be at all.
    """
    count = int(image.max(initial=-1)) + 1
    best = readings(seen, image, allowed, np.full(count, MISSED))[0].pairs
    return np.where(best == NEW, NONE, best)


def readings(seen: Innovations, image: IntArray, allowed: BoolArray, new: Array) -> list[Reading]:
    """The likely ways to read an image, the best first: one for each choice of the sightings that are of new landmarks,
    where such a one costs `new` (m,)."""
    inside = allowed & (seen.distance <= gate(seen.rank))
    count = len(new)
    search = _Search(seen, [np.flatnonzero(inside & (image == n)) for n in range(count)], new)
    search.expand(0, [], 0.0, 0.0)
    out: dict[tuple[bool, ...], list[tuple[list[int | None], float]]] = {}
    for hypothesis, cost in sorted(search.found, key=lambda found: found[1]):
        out.setdefault(tuple(pair is None for pair in hypothesis), []).append((hypothesis, cost))
    return [_read(alike) for alike in out.values()]


def _read(alike: Sequence[tuple[list[int | None], float]]) -> Reading:
    """The best of hypotheses with the same new sightings; what others nearly as likely say otherwise is left open, and
    shared among them as they are likely."""
    best, cost = alike[0]
    close = [(other, misfit) for other, misfit in alike if misfit - cost < OPEN]
    pairs = np.array([NEW if pair is None else pair for pair in best], np.int64)
    shares: list[dict[int, float]] = []
    for n, pair in enumerate(best):
        if pair is None:
            continue
        share: dict[int, float] = {}
        for other, misfit in close:
            mine = other[n]
            assert mine is not None
            share[mine] = share.get(mine, 0.0) + float(np.exp(0.5 * (cost - misfit)))
        if len(share) > 1:
            pairs[n] = UNSURE
        shares.append(share)
    return Reading(pairs, cost, tuple(shares))


class _Search:
    """All hypotheses that are compatible and not much less likely than the best."""

    def __init__(self, seen: Innovations, candidates: Sequence[IntArray], new: Array) -> None:
        self.seen, self.new = seen, new
        self.candidates = [c[np.argsort(seen.distance[c], kind="stable")] for c in candidates]
        self.found: list[tuple[list[int | None], float]] = []
        self.best = np.inf
        self.steps = MOST_STEPS
        self.limit = gate(np.arange(len(candidates) + 1) * int(seen.rank.max(initial=1)))

    def expand(self, place: int, chosen: list[int | None], matched: float, fresh: float) -> None:
        """All hypotheses that begin with `chosen`, whose matches cost `matched` and whose new landmarks `fresh`."""
        if matched + fresh > self.best + UNLIKELY or (self.steps <= 0 and np.isfinite(self.best)):
            return
        if place == len(self.candidates):
            self.found.append((list(chosen), matched + fresh))
            self.best = min(self.best, matched + fresh)
            return
        before = [pair for pair in chosen if pair is not None]
        taken = set(self.seen.targets[before].tolist())
        for pair in self.candidates[place].tolist():
            if int(self.seen.targets[pair]) in taken:
                continue
            self.steps -= 1
            distance, misfit = self.seen.together(np.array([*before, pair]))
            if distance <= self.limit[len(before) + 1]:
                self.expand(place + 1, [*chosen, pair], misfit, fresh)
        self.expand(place + 1, [*chosen, None], matched, fresh + float(self.new[place]))
