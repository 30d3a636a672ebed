"""Landmarks that are several: what was taken for one thing may be two that stand close together.

With a map's poses, the residuals e_i of a landmark's sightings say where each would have it, by J_i d = e_i. One place
d for all of them costs Q1 = min sum |e_i - J_i d|^2 in S_i; two places, each for the sightings that are nearer to it,
cost Q2. Where Q1 - Q2 is more than chance gives and a landmark costs, it is two.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import Array, BoolArray

WORTH = 30.0  # of -2 log likelihood: what a landmark more must explain
LEAST = 3  # sightings of each
ROUNDS = 20


def in_two(error: Array, slope: Array, spread: Array) -> BoolArray | None:
    """Which sightings (m,) are of a second landmark; None where one place explains them.

    `error` (m, r) to the landmark as it is, `slope` (m, r, q) of its place, `spread` S (m, r, r).
    """
    if len(error) < 2 * LEAST:
        return None
    weight = np.linalg.inv(spread)
    gram = np.swapaxes(slope, 1, 2) @ weight @ slope
    right = np.einsum("mrq,mrs,ms->mq", slope, weight, error)
    length = np.einsum("mr,mrs,ms->m", error, weight, error)
    own = np.linalg.solve(gram + 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(gram.shape[1]),
                          right[..., None])[..., 0]  # fmt: skip
    everything = np.ones(len(error), bool)
    one = _cost(gram, right, length, [everything])
    best, cost = None, one - WORTH
    for start in _starts(own, gram):
        part = start
        for _ in range(ROUNDS):
            if min(part.sum(), (~part).sum()) < LEAST:
                break
            off = [_off(gram, right, length, _place(gram, right, side)) for side in (part, ~part)]
            again = off[0] < off[1]
            if (again == part).all():
                break
            part = again
        if min(part.sum(), (~part).sum()) >= LEAST and (found := _cost(gram, right, length, [part, ~part])) < cost:
            best, cost = part, found
    return best


def _starts(own: Array, gram: Array) -> list[BoolArray]:
    """Cuts along the directions in which the sightings differ most."""
    middle = np.median(own, axis=0)
    weight = np.sqrt(np.trace(gram, axis1=1, axis2=2))[:, None]
    _, _, axes = np.linalg.svd(weight * (own - middle), full_matrices=False)
    return [(own - middle) @ axis > 0.0 for axis in axes]


def _place(gram: Array, right: Array, part: BoolArray) -> Array:
    return np.asarray(np.linalg.lstsq(gram[part].sum(0), right[part].sum(0), rcond=None)[0])


def _off(gram: Array, right: Array, length: Array, place: Array) -> Array:
    return np.asarray(length - 2.0 * right @ place + np.einsum("i,mij,j->m", place, gram, place))


def _cost(gram: Array, right: Array, length: Array, parts: Sequence[BoolArray]) -> float:
    return float(sum(_off(gram, right, length, _place(gram, right, p))[p].sum() for p in parts))
