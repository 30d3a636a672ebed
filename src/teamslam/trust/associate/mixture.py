"""Who is who among landmarks that stand closer together than a map knows where it was looked from.

All that one image shows is off by one and the same vector, as far as the map is wrong about the pose that it was taken
from: o ~ N(0, off^2). So of n landmarks c_1 .. c_n, each found in a share p_k of sightings, an image's places y_1 ..
y_m, with covariances R_i of what the sensor says, are distributed as

    y_i = c_w(i) + o + N(0, R_i),    w one to one, or y_i is of none of them

and a sum over all w gives the likelihood of an image. Expectation and maximisation find the landmarks; one more is
believed where it explains far more than chance, and where it is not just a known one seen from a pose that is off: then
no image shows both. Images that show several tell the shape of a group, and then from where those were taken that show
one.

Source: Dempster, Laird, Rubin, "Maximum likelihood from incomplete data" (1977); Schwarz (1978) for how many.
"""

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from teamslam.geometry import Array, IntArray

TOGETHER = 3  # sightings of an image that are weighed together; more are weighed in parts
STRAY = 0.01  # of sightings are of none
GAIN = 5.0  # of log likelihood beyond Schwarz's, for one more landmark
MOST = 12  # landmarks of a group
TRIES = 4  # places to begin with for one more
FEWEST = 5  # sightings of a landmark
APART = 0.1  # of the sightings of the rarer one, that images show beside another where they are two
ROUNDS, QUICK = 40, 6


@dataclass(frozen=True, eq=False)
class Group:
    """Landmarks at `places` (n, d), and of every sighting how likely it is of each, and of none (m, n + 1)."""

    places: Array
    odds: Array


def told_apart(places: Array, spread: Array, images: IntArray, off: float) -> Group:
    """The landmarks of which sightings say that they are at `places` (m, d), with covariance `spread` (m, d, d), in
    `images` (m,) taken from poses that are `off` [m] in every direction."""
    middle = np.median(places, 0)
    mixture = _Mixture(places - middle, spread, images, off)
    best = mixture.fitted(np.zeros((1, places.shape[1])), ROUNDS)
    while len(best.places) < MOST:
        more = _one_more(mixture, best, len(best.places))
        price = 0.5 * (places.shape[1] + 1) * np.log(mixture.images) + GAIN
        if more.likelihood - best.likelihood < price or more.counts.min() < FEWEST or _same(more, off):
            break
        best = more
    return Group(best.places + middle, best.odds)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Landmarks with the sightings of each (`counts`), and of any two how often one image shows both (`both`)."""

    places: Array
    likelihood: float
    counts: Array
    both: Array
    odds: Array


def _one_more(mixture: "_Mixture", best: _Fit, known: int) -> _Fit:
    """The best fit with one more landmark, from a few that begin where sightings fit badly."""
    rng = np.random.default_rng(known)
    off = np.sum((mixture.places[:, None] - best.places) ** 2, -1).min(1)
    starts = [
        np.concatenate([best.places, mixture.places[[rng.choice(len(off), p=off / off.sum())]]])
        for _ in range(TRIES)
        if off.any()
    ]
    shown = mixture.shown(known + 1)
    starts += [mixture.places[shown[n]] for n in rng.integers(len(shown), size=min(len(shown), TRIES))]
    tried = [mixture.fitted(start, QUICK) for start in starts] or [best]
    return mixture.fitted(max(tried, key=lambda fit: fit.likelihood).places, ROUNDS)


def _same(fit: _Fit, off: float) -> bool:
    """Whether two landmarks are one that was seen from poses that are off: they are close, and no image shows both."""
    apart = np.linalg.norm(fit.places[:, None] - fit.places, axis=-1)
    rarer = np.minimum(fit.counts[:, None], fit.counts)
    return bool(np.triu((fit.both < APART * rarer) & (apart < 3.0 * off), 1).any())


@dataclass(frozen=True, eq=False)
class _Sum:
    """Of images (n, m sightings) the part in which sightings `on` are of landmarks: their precision (n, k, d, k, d),
    that times their places (n, k, d), and the logarithm (n,) of what does not depend on the landmarks."""

    on: tuple[int, ...]
    precision: Array
    pulled: Array
    constant: Array


class _Mixture:
    """Images of one group, those with as many sightings together, ready for sums over who is who."""

    def __init__(self, places: Array, spread: Array, images: IntArray, off: float) -> None:
        self.places = places
        reach = np.ptp(places, axis=0) + 6.0 * off
        self.stray = float(np.log(STRAY) - np.log(reach).sum())
        order = np.argsort(images, kind="stable")
        parts = [
            part
            for image in np.split(order, np.flatnonzero(np.diff(images[order])) + 1)
            for part in np.split(image, range(TOGETHER, len(image), TOGETHER))
        ]
        self.images = len(parts)
        alike = {m: np.array([part for part in parts if len(part) == m]) for m in {len(part) for part in parts}}
        self.parts = [(rows, self._sums(rows, spread, off)) for _, rows in sorted(alike.items())]

    def shown(self, count: int) -> IntArray:
        """The sightings of images that show so many (n, count)."""
        return next((rows for rows, _ in self.parts if rows.shape[1] == count), np.zeros((0, count), np.int64))

    def _sums(self, rows: IntArray, spread: Array, off: float) -> list[_Sum]:
        n, m, d = *rows.shape, self.places.shape[1]
        out = []
        for on in (on for k in range(m, 0, -1) for on in combinations(range(m), k)):
            k = len(on)
            joint = np.broadcast_to(off**2 * np.eye(d)[:, None, :], (n, k, d, k, d)).copy()
            for place, which in enumerate(on):
                joint[:, place, :, place] += spread[rows[:, which]]
            joint = joint.reshape(n, k * d, k * d)
            y = self.places[rows[:, on]].reshape(n, k * d)
            precision: Array = np.asarray(np.linalg.inv(joint))
            pulled = (precision @ y[..., None])[..., 0]
            size = np.linalg.slogdet(2.0 * np.pi * joint)[1] + np.sum(y * pulled, -1)
            out.append(_Sum(on, precision.reshape(n, k, d, k, d), pulled.reshape(n, k, d),
                            -0.5 * size + (m - k) * self.stray))  # fmt: skip
        return out

    def fitted(self, start: Array, rounds: int) -> _Fit:
        """The landmarks that are likeliest, from some to begin with."""
        places, n, d = start, *start.shape
        shares, before = np.full(n, 1.0 / n), -np.inf
        for _ in range(rounds):
            likelihood, H, g, both, odds = self._expected(places, np.log(shares))
            counts = odds[:, :-1].sum(0)
            if likelihood - before < 0.1:
                break
            before = likelihood
            places = np.asarray(np.linalg.solve(H + 1e-9 * np.eye(n * d), g.ravel()).reshape(n, d))
            shares = (counts + 1.0) / (counts.sum() + n)
        return _Fit(places, likelihood, counts, both, odds)

    def _expected(self, c: Array, log_share: Array) -> tuple[float, Array, Array, Array, Array]:
        """The log likelihood, normal equations H (n d, n d) and g (n, d) of the landmarks, how often images show two
        (n, n), and the odds of every sighting (m, n + 1)."""
        n, d = c.shape
        H, g, both = np.zeros((n, n, d, d)), np.zeros((n, d)), np.zeros((n, n))
        odds, total = np.zeros((len(self.places), n + 1)), 0.0
        for rows, sums in self.parts:
            sums = [s for s in sums if len(s.on) <= n]
            ways = [np.array(list(permutations(range(n), len(s.on)))) for s in sums]
            logs = [_logs(s, w, c, log_share) for s, w in zip(sums, ways, strict=True)]
            none = np.full((len(rows), 1), rows.shape[1] * self.stray)
            each = np.concatenate([*logs, none], 1)
            top = each.max(1, keepdims=True)
            weight = np.exp(each - top)
            whole = weight.sum(1, keepdims=True)
            total += float((top + np.log(whole)).sum())
            weight /= whole
            odds[rows, n] += weight[:, -1:]
            starts = np.cumsum([0, *map(len, ways)])
            for s, w, first in zip(sums, ways, starts.tolist(), strict=False):
                p = weight[:, first : first + len(w)]
                for place in set(range(rows.shape[1])) - set(s.on):
                    odds[rows[:, place], n] += p.sum(1)
                one = [np.eye(n)[w[:, q]] for q in range(len(s.on))]
                for q, which in enumerate(s.on):
                    mine = p @ one[q]
                    odds[rows[:, which], :n] += mine
                    g += mine.T @ s.pulled[:, q]
                    for r in range(len(s.on)):
                        pair = (p @ (one[q][:, :, None] * one[r][:, None]).reshape(len(w), -1)).reshape(-1, n, n)
                        H += np.einsum("ikl,ide->klde", pair, s.precision[:, q, :, r])
                        both += pair.sum(0)
        return total, H.transpose(0, 2, 1, 3).reshape(n * d, n * d), g, both, odds


def _logs(s: _Sum, ways: IntArray, c: Array, log_share: Array) -> Array:
    """The log likelihood (n, ways) of images in which the sightings that are `on` are of landmarks in these ways."""
    linear = np.einsum("iqd,kd->iqk", s.pulled, c)
    square = np.einsum("kd,iqdre,le->iqrkl", c, s.precision, c)
    out = np.broadcast_to(s.constant[:, None], (len(s.constant), len(ways))).copy()
    for q in range(len(s.on)):
        out += linear[:, q, ways[:, q]] + log_share[ways[:, q]]
        for r in range(len(s.on)):
            out -= 0.5 * square[:, q, r, ways[:, q], ways[:, r]]
    return out
