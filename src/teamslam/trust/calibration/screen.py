"""Whether anything at all is wrong with the model of the data: asked first, as it costs little and most often ends it.

One solve, by the factor of the map that the verdict on the fit uses as well, says what the map leaves of the errors
measured and of a few drawn from the model as it is stated. Of both,

    sizes    the mean square of each part of each sensor
    slips    the score of odometry's slips
    signs    products of errors that follow each other, of one target and across targets, and how far off each target is
    pulls    what is left in the direction of each kind of systematic error

are held beside each other (see `beside`). The four share SUSPICION among them, and each shares its part among its
numbers (Bonferroni): of teams with a right model fewer are looked at more closely, and of these fewer still are changed
(`search`, `choice`). Of a long log windows of rows are looked at, NUMBERS in all: what is wrong shows in these. Of a
very long one, of which a closer look takes long, what stands out is asked again of AGAIN times as many other windows,
beside MOST_DRAWS new draws: what is there stands out twice as far in these, and what was chance is gone, be it that of
the rows or, in a small table, that of few draws.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.joining import AtMap
from teamslam.model import Names, Table
from teamslam.trust.calibration.beside import in_pieces, odds, odds_of_gaussian
from teamslam.trust.calibration.choice import differences
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.persistence import targets_of
from teamslam.trust.calibration.rows import is_sighting, lasting_of, velocities
from teamslam.trust.calibration.sizes import LEAST
from teamslam.trust.calibration.slipping import squares_of_rows
from teamslam.trust.calibration.slips import Slips
from teamslam.trust.calibration.terms import effects_of, scene_of

SUSPICION = 0.05  # of teams with a right model
MOST_DRAWS, LEAST_DRAWS, DRAWN = 16, 4, 250_000  # numbers drawn in all, about
NUMBERS, WINDOW = 30_000, 128  # looked at, in windows of so many rows
AGAIN = 4


@dataclass(frozen=True, eq=False)
class Glance:
    """The rows of a `table` that are looked at: their `noise` as stated, what is left (m, r, 1 + draws) of the `errors`
    measured and drawn and the `sizes` of these, what the loss weighs them by (m,), and the `rate` (m, r) at which
    residuals change."""

    table: Table
    noise: Noise
    errors: Array
    sizes: Array
    weight: Array
    rate: Array


def suspicious(at: AtMap) -> bool:
    """Whether a closer look at a map's rows is worth its time. Raises SolveError where they do not determine it."""
    return all(_stands_out(at, seen) for seen in _looks(at))


def _stands_out(at: AtMap, seen: Sequence[Glance]) -> bool:
    names = at.joined.names
    asked = (_sizes(seen), _slips(seen, names), _signs(seen, names), _pulls(at, seen, names))
    return any(min(each) < SUSPICION / 4 / len(each) for each in map(list, asked) if each)


def _looks(at: AtMap) -> Iterator[list[Glance]]:
    """The rows that are looked at, beside as many draws as the log is small, and those that are asked again, beside
    most."""
    measured = [at.gap.system.whitened(place, at.values) for place in range(len(at.tables))]
    numbers = sum(u.size for u in measured)
    every, windows = 1 + numbers // NUMBERS, [np.arange(len(u)) // WINDOW for u in measured]
    draws = int(np.clip(DRAWN // max(numbers, 1), LEAST_DRAWS, MOST_DRAWS))
    yield _look(at, measured, np.random.default_rng(0), draws, [w % every == 0 for w in windows])
    if every > AGAIN:  # of a table with few windows all of them again
        seen = [(w % every <= AGAIN) & ((w % every > 0) | (w[-1] <= AGAIN)) for w in windows]
        yield _look(at, measured, np.random.default_rng(1), MOST_DRAWS, seen)


def _look(
    at: AtMap, measured: Sequence[Array], rng: np.random.Generator, draws: int, seen: Sequence[BoolArray]
) -> list[Glance]:
    """What is left of errors measured and drawn, of the rows of each table that are `seen`. All rows pull; those that
    nobody looks at are let go of as soon as they have."""
    system, values, names = at.gap.system, at.values, at.joined.names
    weights = [table.loss.weight(np.sum(u**2, -1)) for table, u in zip(at.tables, measured, strict=True)]
    kept: list[Array] = []

    def pulls() -> Iterator[Array]:
        for table, u, weight, which in zip(at.tables, measured, weights, seen, strict=True):
            both = np.concatenate([u[..., None], rng.standard_normal((*u.shape, draws), np.float32)], -1)
            if not (told := (table.whitening != 0.0).any(-1)).all():
                both *= told[..., None]
            kept.append(both if which.all() else both[which])
            yield both if table.loss.name == "squared" else both * _felt(table, both, weight)[:, None]

    steps = at.gap.factor.solve(system.pull(values, pulls()))
    tables = [table if which.all() else table.select(which) for table, which in zip(at.tables, seen, strict=True)]
    shown = system if all(which.all() for which in seen) else system.alike(tables, ())
    still = names.counts
    velocity = np.zeros(system.free.dof) if still else velocities(values, system.free, names)
    ahead = shown.along(values, np.column_stack([steps, velocity]))
    of_seen = [weight[which] for weight, which in zip(weights, seen, strict=True)]
    return [_glance(*each) for each in zip(tables, kept, of_seen, ahead, strict=True)]


def _felt(table: Table, both: Array, weight: Array) -> Array:
    """What the loss weighs rows by (m, 1 + draws), each draw by its own size."""
    return np.column_stack([weight, table.loss.weight(np.sum(both[..., 1:] ** 2, 1))])


def _glance(table: Table, both: Array, weight: Array, ahead: Array) -> Glance:
    noise = Noise.stated(table)
    errors = noise.errors(both - ahead[..., :-1])
    return Glance(table, noise, errors, noise.sizes(errors), weight, -noise.errors(ahead[..., -1:])[..., 0])


def _sizes(seen: Sequence[Glance]) -> Iterator[float]:
    for each in seen:
        squares = each.sizes**2
        pieces = in_pieces(squares)
        for part in range(squares.shape[1]):
            if squares[:, part, 1:].mean() > LEAST:  # a map may take up all of it
                yield odds(pieces[:, part], squares=True)


def _slips(seen: Sequence[Glance], names: Names) -> Iterator[float]:
    pieces = []
    for each in seen:
        slips = Slips.of(each.table, lasting_of(each.table, names))
        squares = None if slips is None else squares_of_rows(slips, each.noise, each.errors)
        if squares is not None:
            pieces.append(in_pieces(np.moveaxis(squares, 1, 0)))
    if pieces:
        together = np.concatenate(pieces)
        yield from (odds(together[:, slip], squares=True) for slip in range(together.shape[1]))


def _signs(seen: Sequence[Glance], names: Names) -> Iterator[float]:
    """Of each part of each kind of sighting, all robots together."""
    mine = sorted((each for each in seen if is_sighting(each.table)), key=lambda each: each.table.kind)
    for _, group in groupby(mine, lambda each: each.table.kind):
        for number, pieces in enumerate(zip(*(_hanging(each, names) for each in group), strict=True)):
            together = np.concatenate(pieces)
            yield from (odds(together[:, part], squares=number == 2) for part in range(together.shape[1]))


def _hanging(each: Glance, names: Names) -> tuple[Array, Array, Array]:
    """Products of errors that follow each other, of one target, of different ones; and the squares of what all of one
    target add up to: each in pieces (pieces, rows, 1 + draws)."""
    size = each.sizes / np.sqrt(np.maximum(np.mean(each.sizes**2, 0), 1e-300))
    targets, stamps = targets_of(each.table), names.stamps_s(each.table.keys[:, 0])
    same, across = np.lexsort((stamps, targets)), np.argsort(stamps, kind="stable")
    alike, other = (targets[order][1:] == targets[order][:-1] for order in (same, across))
    starts = np.flatnonzero(np.append(True, ~alike))
    counts = np.diff(np.append(starts, len(same)))
    by_target = size[same]
    together = np.add.reduceat(by_target, starts) ** 2 / counts[:, None, None]
    return (_products(by_target, alike), _products(size[across], ~other), in_pieces(together))


def _products(sizes: Array, which: BoolArray) -> Array:
    """Of sizes (m, rows, 1 + draws) with the next ones, where it counts (m - 1,)."""
    return in_pieces(sizes[1:] * sizes[:-1] * which[:, None, None])


def _pulls(at: AtMap, seen: Sequence[Glance], names: Names) -> Iterator[float]:
    """Of each kind of systematic error, how large what is left along those of all robots is."""
    along: dict[tuple[str, ...], list[Array]] = {}
    relative: dict[tuple[str, ...], bool] = {}
    for each in seen:
        table, noise = each.table, each.noise
        scene = scene_of(table, at.values, lasting_of(table, names), each.rate)
        left = (noise.whitening @ each.errors) * each.weight[:, None, None]
        for term, _, effect in effects_of(scene):
            whitened = (noise.whitening @ effect[..., None])[..., 0]
            size = float(np.sqrt(np.sum(whitened**2 * each.weight[:, None])))
            kind = (term.name, *(() if term.relative else (table.source, table.model)))
            along.setdefault(kind, []).append(whitened.ravel() @ left.reshape(whitened.size, -1) / max(size, 1e-300))
            relative[kind] = term.relative
    for kind, numbers in along.items():
        stacked = np.stack(numbers)
        if relative[kind]:
            stacked = differences(len(stacked)).T @ stacked
        if len(stacked):
            yield odds_of_gaussian(stacked)
