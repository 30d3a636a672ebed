"""The same number from stretches of a recording, each by itself, at the map: does it hold all along, or does it drift?

q_w = (D_w' W D_w)^-1 D_w' W e_w,   e_w the rows of stretch w          (the map held, so sigmas are the smallest)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array
from teamslam.joining import AtMap
from teamslam.model import Unknowns, is_pose
from teamslam.trust.unknowns.effects import Effects

COUNT = 12
FEWEST = 3  # rows of a stretch


@dataclass(frozen=True)
class Window:
    """What one stretch of a recording, in the middle at `stamp_s`, says of an unknown: `value` and `sigma`."""

    stamp_s: float
    value: float
    sigma: float


def windows_of(maps: Sequence[AtMap], unknowns: Unknowns, effects: Effects) -> tuple[tuple[Window, ...], ...]:
    """The windows of each unknown, those in which it shows."""
    rows = [row for at in maps for row in _rows(at, effects)]
    if not rows:
        return ((),) * len(unknowns.each)
    stamps, own, pull = (np.concatenate(part) for part in zip(*rows, strict=True))
    out = []
    for k, value in enumerate(unknowns.values.tolist()):
        shows = own[:, k] > 0.0
        out.append(tuple(_windows(stamps[shows], own[shows, k], pull[shows, k], value)))
    return tuple(out)


def _windows(stamps: Array, own: Array, pull: Array, value: float) -> Iterator[Window]:
    if not len(stamps):
        return
    edges = np.linspace(stamps.min(), stamps.max(), COUNT + 1)
    place = np.clip(np.searchsorted(edges, stamps, "right") - 1, 0, COUNT - 1)
    for window in range(COUNT):
        mine = place == window
        if np.count_nonzero(mine) >= FEWEST:
            known = float(own[mine].sum())
            middle = float((stamps[mine] * own[mine]).sum() / known)
            yield Window(middle, value - float(pull[mine].sum()) / known, known**-0.5)


def _rows(at: AtMap, effects: Effects) -> Iterator[tuple[Array, Array, Array]]:
    """Stamps (m,), D'WD (m, k) and D'We (m, k) of each table."""
    for table in at.tables:
        if not is_pose(table.keys[:, 0]).all():
            continue
        effect = effects.at(at, table)
        if not effect.any():
            continue
        weight = table.loss.weight(np.sum(table.whitened(at.values) ** 2, -1))
        white = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
        D, e = white @ effect, table.whitened(at.values)
        stamps = at.joined.names.stamps_s(table.keys[:, 0])
        yield stamps, weight[:, None] * np.sum(D**2, 1), weight[:, None] * np.einsum("mrk,mr->mk", D, e)
