"""Which part of a log carries the cost: sums of rows by sensor, robot, landmark and stretch of time, beside what they
should come to.

A group's cost has a mean and a variance under a right model (see `expected`); it is compared with the gamma
distribution of both, which for the squared loss is chi-square with the group's degrees of freedom.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import chi2_quantile, distinct, index_of, is_landmark
from teamslam.trust.residuals import Rows

PROBABILITY = 0.999  # of a band
STRETCHES = 40  # equal ones that the time of a log is cut into


@dataclass(frozen=True, eq=False)
class Tally:
    """Groups of rows: `labels` (n,), how many rows, what they cost, the mean and variance of that if the model is
    right."""

    labels: IntArray
    rows: IntArray
    cost: Array
    expected: Array
    variance: Array

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def ratio(self) -> Array:
        """Cost over what is expected; groups that have less than one number to spare count as one."""
        return np.asarray(self.cost / np.maximum(self.expected, 1.0))

    @property
    def excess(self) -> Array:
        """Cost above what is expected."""
        return np.asarray(self.cost - self.expected)

    @property
    def band(self) -> tuple[Array, Array]:
        """Between what the cost lies with PROBABILITY, if the model is right."""
        mean, variance = np.maximum(self.expected, 1.0), np.maximum(self.variance, 1.0)
        dof = 2.0 * mean**2 / variance
        tail = 0.5 * (1.0 - PROBABILITY)
        return mean * chi2_quantile(tail, dof) / dof, mean * chi2_quantile(1.0 - tail, dof) / dof

    @property
    def high(self) -> BoolArray:
        """Groups that cost more than the band allows."""
        return np.asarray(self.cost > self.band[1])

    def select(self, index: IntArray | BoolArray) -> "Tally":
        """Some groups."""
        return Tally(self.labels[index], self.rows[index], self.cost[index], self.expected[index], self.variance[index])


def tally(rows: Sequence[Rows], labels: Sequence[IntArray]) -> Tally:
    """Sums over groups: `labels` (m,) for the rows of each table, below 0 for those in none."""
    together = np.concatenate([np.zeros(0, np.int64), *labels])
    known = distinct(together)  # few, of many rows
    group = np.searchsorted(known, together)

    def total(parts: Iterable[Array]) -> Array:
        return np.asarray(np.bincount(group, np.concatenate([np.zeros(0), *parts]), len(known)))

    found = Tally(
        labels=known,
        rows=np.asarray(np.bincount(group, minlength=len(known))),
        cost=total(r.cost for r in rows),
        expected=total(r.expected for r in rows),
        variance=total(r.variance for r in rows),
    )
    return found.select(known >= 0)


def whole(rows: Sequence[Rows]) -> Tally:
    """All rows as one group."""
    return tally(rows, [np.zeros(len(r), np.int64) for r in rows])


def by_sensor(rows: Sequence[Rows]) -> tuple[Tally, list[tuple[int, str, str]]]:
    """By robot, source and model; the labels are places in the list of these that comes with it."""
    kinds = sorted({kind_of(r) for r in rows})
    return tally(rows, [np.full(len(r), kinds.index(kind_of(r))) for r in rows]), kinds


def kind_of(rows: Rows) -> tuple[int, str, str]:
    """Whose rows these are, of which source, and by which model."""
    return rows.table.robot, rows.table.source, rows.table.model


def by_robot(rows: Sequence[Rows]) -> Tally:
    """By who measured; the labels are robots' numbers."""
    return tally(rows, [np.full(len(r), r.table.robot) for r in rows])


def by_landmark(rows: Sequence[Rows]) -> Tally:
    """By the landmark seen; the labels are their keys."""
    targets = [r.table.keys[:, -1] for r in rows]
    return tally(rows, [np.where(is_landmark(keys), keys, -1) for keys in targets])


@dataclass(frozen=True, eq=False)
class Stretches:
    """A tally by robot and time: label = robot * STRETCHES + place. All stretches are `width` ticks long; `start` is
    the tick at which the log begins."""

    tally: Tally
    start: int
    width: float

    @property
    def robots(self) -> IntArray:
        """Whose each stretch is."""
        return np.asarray(self.tally.labels // STRETCHES)

    def since_start(self, label: int) -> float:
        """The ticks from the start of the log to that of a stretch."""
        return self.width * (label % STRETCHES)


def by_stretch(rows: Sequence[Rows]) -> Stretches:
    """By robot and time."""
    seen = [np.where(r.observers > 0, index_of(r.observers), -1) for r in rows]
    known = np.concatenate([t[t >= 0] for t in seen] or [np.zeros(0, np.int64)])
    start, stop = (int(known.min()), int(known.max())) if len(known) else (0, 0)
    width = (stop - start + 1) / STRETCHES
    places = [np.minimum((t - start) / width, STRETCHES - 1).astype(np.int64) for t in seen]
    labels = [np.where(t >= 0, r.table.robot * STRETCHES + p, -1) for r, t, p in zip(rows, seen, places, strict=True)]
    return Stretches(tally(rows, labels), start, width)
