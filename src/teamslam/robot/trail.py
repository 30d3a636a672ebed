"""The filter's way through rows in order of time, with marks to go back to when a row comes late.

A mark is the filter after the rows up to a rank. Marks are kept within the horizon, some apart, and the last one before
it: no row comes earlier. The filter after a row is a function of the rows before it and of where it began; so it does
not matter in which order rows of different times came.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.model import Table, index_of
from teamslam.robot.filter import Filter
from teamslam.robot.rows import ALWAYS, Batch, Rank, rank_of

MARKS = 8  # within the horizon


@dataclass(frozen=True, eq=False)
class Mark:
    """The filter after the rows up to a rank; None before the first pose."""

    rank: Rank
    filter: Filter | None


Trail = tuple[Mark, ...]


@dataclass(frozen=True)
class Pace:
    """What a trail must know: the robot's dimension, how many landmarks it carries, and, in ticks, before when no row
    comes any more and how long ago that is."""

    dim: int
    landmarks: int
    settled: int
    horizon: int


def begun_with(filter_: Filter) -> Mark:
    """A trail that begins at a pose in which all rows up to it are but what was seen from it."""
    return Mark((int(index_of(filter_.key)), True, -1, -1), filter_)


def with_row(trail: Trail, rows: Sequence[Batch], fresh: Batch, pace: Pace) -> Trail:
    """The trail with one batch more, which `rows`, all that are open, hold already."""
    if not trail or fresh.rank > trail[-1].rank:
        return along(trail, [fresh], pace)
    kept = tuple(mark for mark in trail if mark.rank < fresh.rank)
    return along(kept, rows[bisect_right(rows, kept[-1].rank, key=rank_of) :] if kept else rows, pace)


def along(trail: Trail, rows: Sequence[Batch], pace: Pace) -> Trail:
    """The trail through more batches, in order."""
    for batch in rows:
        before = trail[-1].filter if trail else None
        trail = _thinned((*trail, Mark(batch.rank, _after(before, batch, pace))), pace)
    return trail


def _after(filter_: Filter | None, batch: Batch, pace: Pace) -> Filter | None:
    """The filter after a batch. Where no odometry leads to a pose, it begins there anew, in a frame of its own."""
    table = batch.table
    if batch.time == ALWAYS:
        return filter_
    if batch.moves:
        return _moved(filter_ or Filter.at(int(table.keys.min()), pace.dim), table, pace)
    at = int(table.keys[0, 0])
    if filter_ is None or at > filter_.key:
        filter_ = Filter.at(at, pace.dim)
    if at < filter_.key:
        return filter_
    filter_ = filter_.recalled(table)
    seen = filter_.seen(table)
    return seen if table.row.unary else _with_new(filter_, seen, table).near(pace.landmarks)


def _with_new(before: Filter, seen: Filter, table: Table) -> Filter:
    """With what was seen for the first time; what was seen of it twice at once counts once more."""
    entered = seen.entered(table)
    if entered is seen:
        return seen
    again = np.fromiter((key not in before.order.place for key in table.keys[:, 1].tolist()), bool, len(table))
    _, first = np.unique(table.keys[:, 1], return_index=True)
    again[first] = False
    return entered.seen(table.select(again)) if again.any() else entered


def _moved(filter_: Filter, table: Table, pace: Pace) -> Filter:
    """Along the relative poses between the pose of the filter and the next one; others (loop closures) are for maps."""
    pairs = [sorted(keys) for keys in table.keys.tolist()]
    onward = [first == filter_.key < last for first, last in pairs]
    if not any(onward):
        start = max(first for first, _ in pairs)
        if start <= filter_.key:
            return filter_
        filter_, onward = Filter.at(start, pace.dim), [first == start for first, _ in pairs]
    moved = filter_.moved(table if all(onward) else table.select(np.array(onward)))
    return moved or Filter.at(max(last for (_, last), on in zip(pairs, onward, strict=True) if on), pace.dim)


def _thinned(trail: Trail, pace: Pace) -> Trail:
    """Without marks that nobody will go back to, or close to another."""
    if len(trail) > 2 and MARKS * (trail[-2].rank[0] - trail[-3].rank[0]) < pace.horizon:
        trail = (*trail[:-2], trail[-1])
    needed = next((n for n in range(len(trail) - 1) if trail[n + 1].rank[0] >= pace.settled), len(trail) - 1)
    return trail[needed:]
