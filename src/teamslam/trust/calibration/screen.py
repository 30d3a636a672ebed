"""Whether anything at all is wrong with the model of the data: asked first, as it costs little and most often ends it.

One solve, by the factor of the map that the verdict on the fit uses as well, says what the map leaves of the errors
measured and of errors drawn from the model as it is stated. Of both,

    sizes    the mean square of each part of each sensor
    slips    the score of odometry's slips
    signs    products of errors that follow each other, of one target and across targets, and how far off each target is
    pulls    what is left in the direction of each kind of systematic error

are held beside each other, squares by their cube roots (Wilson and Hilferty: nearly Gaussian for any number of them).
The four share SUSPICION among them, and each shares its part among its numbers (Bonferroni): of teams with a right
model fewer are looked at more closely, and of these fewer still are changed (`search`, `choice`).
"""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import Names, Table
from teamslam.trust.calibration.choice import Choice, differences
from teamslam.trust.calibration.drawn import beside_drawn, by_chance, off
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.persistence import targets_of
from teamslam.trust.calibration.posterior import Fit
from teamslam.trust.calibration.rows import Linear, is_sighting
from teamslam.trust.calibration.sizes import LEAST
from teamslam.trust.calibration.slipping import Scores
from teamslam.trust.calibration.slips import Slips

SUSPICION = 0.05  # of teams with a right model


def suspicious(linear: Linear, stated: Sequence[Noise], slips: Sequence[Slips | None], white: Array) -> bool:
    """Whether a closer look is worth its time, with draws made of `white` noise. Raises SolveError where the rows do
    not determine the map."""
    errors = linear.by_tables(linear.errors[:, None])
    roots = [np.sqrt(n.weights(e))[..., None] * n.whitening for n, e in zip(stated, errors, strict=True)]
    fit = Fit.by(linear, roots, linear.at.gap.factor, Choice.none())
    left = fit.left(beside_drawn(linear, stated, white))
    both = linear.by_tables(left)
    sizes = [noise.sizes(each) for noise, each in zip(stated, both, strict=True)]
    asked = (_sizes(sizes), np.cbrt(Scores.of(slips, stated, both).squares), _signs(linear, sizes), _pulls(fit, left))
    return any(_stands_out(numbers) for numbers in asked)


def _stands_out(numbers: Array) -> bool:
    """Whether any of some numbers (k, 1 + DRAWS) is farther off than chance makes it."""
    return len(numbers) > 0 and bool((np.abs(off(numbers)) > by_chance(SUSPICION / 4 / len(numbers))).any())


def _sizes(sizes: Sequence[Array]) -> Array:
    squares = [np.sum(size**2, 0) for size in sizes]
    told = [part[part[:, 1:].mean(-1) > LEAST] for part in squares]  # a map may take up all of it
    return np.asarray(np.cbrt(np.concatenate(told)))


def _signs(linear: Linear, sizes: Sequence[Array]) -> Array:
    """Of each part of each kind of sighting, all robots together."""
    mine = [(table, size) for table, size in zip(linear.tables, sizes, strict=True) if is_sighting(table)]
    mine.sort(key=lambda both: both[0].kind)
    numbers = [
        np.sum([_hanging(table, size, linear.names) for table, size in group], 0)
        for _, group in groupby(mine, lambda both: both[0].kind)
    ]
    return np.concatenate([part.reshape(-1, part.shape[-1]) for part in numbers]) if numbers else np.zeros((0, 1))


def _hanging(table: Table, sizes: Array, names: Names) -> Array:
    """Products (rows, 1 + DRAWS) of errors that follow each other, of one target, of different ones; and the squares of
    what all of one target add up to (3, rows, 1 + DRAWS)."""
    size = sizes / np.sqrt(np.maximum(np.mean(sizes**2, 0), 1e-300))
    targets, stamps = targets_of(table), names.stamps_s(table.keys[:, 0])
    same, across = np.lexsort((stamps, targets)), np.argsort(stamps, kind="stable")
    alike, other = (targets[order][1:] == targets[order][:-1] for order in (same, across))
    starts = np.flatnonzero(np.append(True, ~alike))
    counts = np.diff(np.append(starts, len(same)))
    together = np.add.reduceat(size[same], starts) ** 2 / counts[:, None, None]
    return np.stack([_products(size[same], alike), _products(size[across], ~other), np.sum(together, 0)])


def _products(sizes: Array, which: BoolArray) -> Array:
    """Of sizes (m, rows, 1 + DRAWS) with the next ones, where it counts (m - 1,)."""
    return np.asarray(np.sum(sizes[1:][which] * sizes[:-1][which], 0))


def _pulls(fit: Fit, left: Array) -> Array:
    """Of each kind of systematic error, how large what is left along those of all robots is."""
    linear, squares = fit.linear, []
    pulls, groups, relative = linear.effects.T @ (fit.weight @ left), linear.groups, linear.relative
    for kind in np.unique(groups):
        mine = groups == kind
        along = differences(int(mine.sum())).T @ pulls[mine] if relative[mine].any() else pulls[mine]
        expected = np.mean(along[:, 1:] ** 2, -1, keepdims=True)
        squares.append(np.sum(along**2 / np.maximum(expected, 1e-300), 0))
    return np.asarray(np.cbrt(np.stack(squares))) if squares else np.zeros((0, 1))
