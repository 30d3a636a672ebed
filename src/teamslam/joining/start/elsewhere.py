"""Landmarks that came to lie where a loss forgives what sees them: put where that is seen for less.

A start may be off by many sigmas. Landmarks placed from it are off as far, and where a loss forgives what is far off
nothing draws them back once the poses have found their places. There, by all that sees them, they are placed anew.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, IntArray
from teamslam.joining.start.triangulate import Bundle
from teamslam.model import Kind, Table, Values, is_landmark
from teamslam.solver import Solution

T = TypeVar("T")

CONTRADICTED = 4.0  # times as large as their sigmas say, squared: what residuals of a landmark are before it is asked
GAINS = 2.0  # of cost: less is not worth another search
AGAIN = 2  # times that a map is sought from where they came to lie
REFINEMENTS = 4  # of a few steps each, from each proposal


def while_lower(
    found: T, solution: Callable[[T], Solution], other: Callable[[T], Values | None], search: Callable[[Values], T]
) -> T:
    """What is `found`, or what a `search` finds from where an `other` look (as `elsewhere`) has its landmarks, while
    that is a lower optimum of no fewer variables."""
    for _ in range(AGAIN):
        start = other(found)
        if start is None:
            break
        try:
            again = search(start)
        except SolveError:
            break
        here, there = solution(found), solution(again)
        if len(there.values) < len(here.values) or not there.is_lower_than(here):
            break
        found = again
    return found


def elsewhere(values: Values, tables: Sequence[Table], held: IntArray) -> Values | None:
    """`values` with the landmarks moved, but for those that are `held`, that cost less where their sightings in
    `tables` put them, all poses where they are; None where there are none. Poses are asked only of landmarks that their
    sightings contradict."""
    marks = [t.select(is_landmark(t.keys[:, -1])) for t in tables if not t.row.unary]
    marks = [t.select(np.asarray(values.layout.contains(t.keys).all(1))) for t in marks]
    surveyed = [t.keys[:, 0] for t in tables if t.row.unary]
    keys = np.setdiff1d(_contradicted(values, marks), np.concatenate([held, *surveyed]))
    moved = values
    for kind in (Kind.POINT2, Kind.POINT3):
        own = keys[values.layout.kinds[values.layout.index(keys)] == kind]
        bundle = Bundle.of(marks, values, own, kind.dim)
        if not bundle.rays:
            continue
        places, gains = _cheapest(bundle, values.positions(own, kind.dim))
        if (go := gains > GAINS).any():
            moved = moved.update(Values.of({kind: (own[go], places[go])}))
    return None if moved is values else moved


def _contradicted(values: Values, marks: Sequence[Table]) -> IntArray:
    """The landmarks whose residuals are far larger than their sigmas say."""
    squared = [np.zeros(0), *(np.sum(t.whitened(values) ** 2, -1) for t in marks)]
    counted = [np.zeros(0), *(t.ranks for t in marks)]
    keys, of = np.unique(np.concatenate([np.zeros(0, np.int64), *(t.keys[:, -1] for t in marks)]), return_inverse=True)
    excess, numbers = (np.bincount(of, np.concatenate(each), len(keys)) for each in (squared, counted))
    return keys[excess > CONTRADICTED * numbers]


def _cheapest(bundle: Bundle, here: Array) -> tuple[Array, Array]:
    """Where each landmark (n, d) costs least of the places that its sightings propose, as far as they hold it there,
    and what is gained by that (n,)."""
    now, places = bundle.costs_at(here), np.concatenate([here[None], bundle.proposals()])
    for _ in range(REFINEMENTS):
        places, costs, information = bundle.refined(places)
    best, each = np.argmin(costs, 0), np.arange(len(here))
    held = bundle.holds(places[best, each], information[best, each])
    return places[best, each], np.where(held, now - costs[best, each], 0.0)
