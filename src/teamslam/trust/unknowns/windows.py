"""The same number from stretches of a recording, each by itself: does it hold all along, or does it drift?

Each stretch has the number for its own, and all of them, and the map, are estimated together from where they are: rows
of one stretch say how the number is there, and the map is no judge of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining import AtMap
from teamslam.model import Table, Unknowns
from teamslam.trust.unknowns.effects import Effects
from teamslam.trust.unknowns.normal import beside_prior, eliminated

COUNT = 12
TOLD = 0.2  # of the prior: a stretch that knows less says nothing


@dataclass(frozen=True)
class Window:
    """What one stretch of a recording, in the middle at `stamp_s`, says of an unknown: `value` and `sigma`."""

    stamp_s: float
    value: float
    sigma: float


def windows_of(maps: Sequence[AtMap], unknowns: Unknowns, effects: Effects) -> tuple[tuple[Window, ...], ...]:
    """The windows of each unknown, those that tell it."""
    stamps = [_stamps(at, table) for at in maps for table in at.tables if effects.at(at, table).any()]
    if not stamps:
        return ((),) * len(unknowns.each)
    edges = np.linspace(min(s.min() for s in stamps), max(s.max() for s in stamps), COUNT + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    k = len(unknowns.each)
    own, slope = np.zeros((COUNT * k, COUNT * k)), np.zeros(COUNT * k)
    for at in maps:
        left, pull = eliminated(at, lambda table, at=at: _apart(effects.at(at, table), at, table, edges))  # type: ignore[misc]
        own, slope = own + left, slope + pull
    return tuple(
        tuple(_told(own[mine, mine], slope[mine], middles, unknown.prior, float(value)))
        for mine, unknown, value in zip(
            [slice(COUNT * n, COUNT * (n + 1)) for n in range(k)], unknowns.each, unknowns.values, strict=True
        )
    )


def _told(own: Array, slope: Array, middles: Array, prior: float, value: float) -> list[Window]:
    known = beside_prior(own + np.eye(COUNT) / prior**2, np.full(COUNT, prior))
    sigmas, steps = np.sqrt(np.diag(known)), known @ slope
    return [
        Window(float(stamp), value + float(step), float(sigma))
        for stamp, step, sigma in zip(middles, steps, sigmas, strict=True)
        if sigma < TOLD * prior
    ]


def _apart(effect: Array, at: AtMap, table: Table, edges: Array) -> Array:
    """The effects (m, rows, k) of each window by itself (m, rows, k COUNT)."""
    mine = _window(_stamps(at, table), edges)[:, None] == np.arange(COUNT)
    return np.asarray((effect[..., None] * mine[:, None, None]).reshape(*effect.shape[:2], -1))


def _window(stamps: Array, edges: Array) -> IntArray:
    return np.asarray(np.clip(np.searchsorted(edges, stamps, "right") - 1, 0, COUNT - 1))


def _stamps(at: AtMap, table: Table) -> Array:
    """When the rows were seen, by who saw; a row without an observer: when its target was there."""
    return np.asarray(at.joined.names.stamps_s(table.keys[:, 0]))
