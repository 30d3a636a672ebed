"""Rows that are far off by themselves, where a loss expects such: single sightings that went wrong.

A few of them are most of what a join costs, and whose they are is chance: what scatters all robots' rows alike accuses
none. So they are no evidence. Of a robot that lies most rows are far off, and many more than of the others': they stay.

    far     squared whitened residual beyond GATE of what noise does, in the map of all
    alone   less than half of a robot's rows of one source are far; or as many as may be by chance, of so many of the
            others' (binomial, LEVEL)
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import BoolArray
from teamslam.joining import Joined
from teamslam.joining.exact.gap import point_of
from teamslam.model import SQUARED, Submap, Table, chi2_quantile

GATE = 0.9999  # of right rows are nearer
LEVEL = 1e-3  # of teams have so many by chance

Sensor = tuple[int, str]  # a robot and a source


def without_scattered(submaps: Sequence[Submap], joined: Joined) -> list[Submap] | None:
    """Submaps without the raw rows that are far off by themselves in the map that they were joined into; None where
    there are none. Law: under a squared loss no row is."""
    tables = [table for submap in submaps for table in submap.raw if len(table) and table.loss != SQUARED]
    far = {id(table): _far(table, joined) for table in tables}
    count: dict[Sensor, tuple[int, int]] = {}
    for table in tables:
        off, of = count.get((table.robot, table.source), (0, 0))
        count[table.robot, table.source] = off + int(far[id(table)].sum()), of + len(table)
    alone = {sensor for sensor, (off, of) in count.items() if off and (2 * off < of or _by_chance(sensor, count))}
    if not alone:
        return None

    def kept(table: Table) -> Table:
        return table.select(~far[id(table)]) if id(table) in far and (table.robot, table.source) in alone else table

    return [replace(submap, raw=tuple(map(kept, submap.raw))) for submap in submaps]


def _far(table: Table, joined: Joined) -> BoolArray:
    """Which rows (m,) of a table are off by more than noise in the map that holds what they speak of."""
    far = np.zeros(len(table), bool)
    for one in joined.maps:
        values = point_of(one)
        here = table.told_by(values.layout)
        if here.any():
            rows = table.select(here)
            far[here] = np.sum(rows.whitened(values) ** 2, -1) > chi2_quantile(GATE, rows.ranks)
    return far


def _by_chance(sensor: Sensor, count: Mapping[Sensor, tuple[int, int]]) -> bool:
    """Whether as many of a robot's rows of one source may be far off by chance as are of all other robots' rows."""
    from scipy.special import bdtrc

    off, of = count[sensor]
    others = np.sum([n for (robot, _), n in count.items() if robot != sensor[0]] or [(0, 0)], axis=0)
    return bool(bdtrc(off - 1, of, (others[0] + 1.0) / (others[1] + 2.0)) >= LEVEL)
