"""Odometry's variance components, settled together where their restricted scores vanish (see `components`).

    f_k  =  1/2 (Q_k - mean of Q_k of errors drawn)

By the noise as it is held to be, errors drawn leave as much as those measured: f = 0, the restricted likelihood's own
equation where rows weigh as they are known, and right as well where they are tempered, as the draws hang together as
errors do. The draws are the same at every step, so f is a smooth function of phi, and where it vanishes does not hang
on where the search began. Steps are by the average information,

    A_kl  =  1/2 y_k' P y_l ,     P = W - W J H^-1 J' W

bent by what steps have shown (Broyden), and halved where they lead away.

Source: Gilmour, Thompson, Cullis, "Average information REML" (Biometrics 51, 1995).
"""

from collections.abc import Callable, Sequence

import numpy as np

from teamslam.geometry import Array
from teamslam.trust.calibration.components import Components, Pulls, told_apart
from teamslam.trust.calibration.drawn import by_chance, off
from teamslam.trust.calibration.slips import Slips

STEPS, HALVINGS = 30, 4
APART = 1.0  # deviation of what is expected of one scale's phi beside that of the others
MOST = 1.4  # of a logarithm in one step
SETTLED = 0.2  # of its own deviation, by which the next step would move it at most
BEGUN, LEAST = 0.1, 0.01  # of what is stated, on the mean of rows: where slips begin, and less than which goes out
OWN, UNSEEN = 0.05, 0.4  # of what rows tell of a slip, that scales do not say as well: else these say it; of one unseen
FARTHER, NEAR = 4.0, 0.5  # than by the average information; steps that show how scores bend

Told = tuple[Array, Array]
Scored = Callable[[Array], Told]
Pulled = Callable[[Components, Sequence[Array], Array], tuple[Pulls, Array]]


def balanced(
    slips: Sequence[Slips | None], scales: Sequence[Array], theta: Array, pulled: Pulled, alarm: float
) -> tuple[list[Array], Array]:
    """Scales (rows,) of each table and theta (slips,) where their restricted scores vanish, from where they are.

    They stay where odometry's noise is as stated and no score stands out, with a false `alarm` in so many teams. A slip
    that is next to nothing, or that scales say as well, goes out; so does one that they say more than half as
    well, unless it was in or its score stands out. `pulled` tells Q and A of components for scales and theta.
    """
    free, known = Components.of(slips, scales), [slip for slip in slips if slip is not None]
    scales, theta = list(scales), theta.copy()
    if not known:
        return scales, theta
    beside = [slip.beside(scale) for slip, scale in zip(slips, scales, strict=True) if slip is not None]
    whole = np.asarray(sum(s.moving.sum() for s in known) / sum(beside))
    pulls, information = pulled(free, scales, theta)
    scaled = len(free.scaled)
    stands = np.append(np.abs(off(pulls.squares)[:scaled]), off(pulls.squares)[scaled:])
    as_stated = not theta.any() and all(scales[k][part] == 1.0 for part, (k, *_) in free.scaled)
    if as_stated and stands.max() <= by_chance(alarm / len(free)):
        return scales, theta
    pace = (pulls.scores / np.maximum(np.diag(information), 1e-300))[scaled:]
    seen = (theta > 0.0) | (stands[scaled:] > by_chance(alarm / len(free)))
    own = np.append(np.ones(scaled, bool), told_apart(known) > np.where(seen, OWN, UNSEEN))
    began, theta = theta, np.where(theta > 0.0, theta, np.clip(pace, BEGUN * whole, whole)) * own[scaled:]
    free = free.only(own)
    begun: Told | None = None
    if (theta == began).all():  # nothing has come in: what is left is known
        begun = expecting(free.logs(scales, theta), len(free.scaled), pulls.scores[own], information[np.ix_(own, own)])
    while True:
        now = free, scales, theta

        def scored(logs: Array, now: tuple[Components, list[Array], Array] = now) -> Told:
            pulls, information = pulled(now[0], *now[0].put(logs, *now[1:]))
            return expecting(logs, len(now[0].scaled), pulls.scores, information)

        least = np.append(np.full(len(free.scaled), -np.inf), np.log(LEAST * whole[list(free.slipping)]))
        logs, begun = settled(free.logs(scales, theta), scored, least, begun), None
        scales, theta = free.put(logs, scales, theta)
        out = logs <= least
        if not out.any():
            return scales, theta
        theta[[k for k, gone in zip(free.slipping, out[len(free.scaled) :], strict=True) if gone]] = 0.0
        free = free.only(~out)


def expecting(logs: Array, scaled: int, scores: Array, information: Array) -> Told:
    """Scores (k,) and information (k, k) of phi = `logs`, the first `scaled` of them of scales, by what is expected
    before any data as well: scales that have one in common, whichever it is, each off it by APART, and slips of any
    deviation alike."""
    even = np.eye(scaled) - 1.0 / max(scaled, 1)
    pull, held = np.full(len(logs), 0.5), np.zeros_like(information)
    pull[:scaled] = -even @ logs[:scaled] / APART**2
    held[:scaled, :scaled] = even / APART**2
    slips = np.arange(scaled, len(logs))
    held[slips, slips] = np.maximum(-scores[slips] - np.diag(information)[slips], 0.0)  # theta itself, where it falls
    return scores + pull, information + held


def settled(start: Array, scored: Scored, least: Array, begun: Told | None = None) -> Array:
    """phi (k,) where scores f vanish, by `scored`, which tells f and A, from a start (where they may be `begun` with);
    or where one that would go on down is at its `least`.

    Law: the same from any start, within SETTLED of its own deviation, unless scores vanish in several places.
    """
    at = np.maximum(start, least)
    score, information = scored(at) if begun is None or (at > start).any() else begun
    bent = information
    for _ in range(STEPS):
        if ((at <= least) & (score < 0.0)).any() or _is_settled(score, information):
            break
        step = _step(bent, score)
        if not 0.0 < float(step @ score) < FARTHER * float(score @ _step(information, score)):
            bent, step = information, _step(information, score)  # steps have shown nothing that holds here
        step *= min(1.0, MOST / max(float(np.abs(step).max()), 1e-300))
        for _ in range(HALVINGS):
            then = np.maximum(at + step, least)
            new, more = scored(then)
            slope = new * np.exp(np.minimum(at - then, 0.0))  # of a variance that grew, by the variance itself
            if float(slope @ _step(information, slope)) <= float(score @ _step(information, score)):
                break
            step *= 0.5
        moved = then - at
        near = bool((np.abs(moved) < NEAR).all())
        bent = bent + np.outer(score - new - bent @ moved, moved) / float(moved @ moved) if near else more
        at, score, information = then, new, more
    return at


def _is_settled(score: Array, information: Array) -> bool:
    doubt = np.sqrt(np.diag(np.linalg.pinv(information)))
    return bool((np.abs(_step(information, score)) <= SETTLED * doubt).all())


def _step(information: Array, score: Array) -> Array:
    return np.asarray(np.linalg.lstsq(information, score, rcond=1e-9)[0])
