"""What would count twice in a join of several submaps: a map that holds one measurement twice is too sure of itself.

a row of a log           in two submaps: their sources overlap
one surveyed prior       written into several robots' logs, where it looks like several measurements
"""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import IntArray
from teamslam.model import Submap, is_landmark

Conflict = tuple[int, int, str]
"""Two places in a list of submaps, and why these exclude each other."""


def refuse_double_counting(submaps: Sequence[Submap]) -> None:
    """Raise ModelError where one measurement went into two submaps."""
    for _, _, why in itertools.chain(rows_in_two(submaps), priors_in_several(submaps)):
        raise ModelError(f"{why}. Leave one of the two out")


def rows_in_two(submaps: Sequence[Submap]) -> Iterable[Conflict]:
    """Each pair of submaps that hold the same rows of a log."""
    logs: dict[tuple[int, str], list[tuple[int, IntArray]]] = {}
    for number, submap in enumerate(submaps):
        for log, edges in submap.sources.edges.items():
            logs.setdefault(log, []).append((number, edges))
    for log, held in sorted(logs.items()):
        yield from _in_two(submaps, log, held)


def _in_two(
    submaps: Sequence[Submap], log: tuple[int, str], held: Sequence[tuple[int, IntArray]]
) -> Iterable[Conflict]:
    numbers = np.repeat([number for number, _ in held], [len(edges) for _, edges in held])
    edges = np.concatenate([edges for _, edges in held])
    order = np.lexsort((numbers, edges[:, 1], edges[:, 0]))
    if (edges[order[1:], 0] >= np.maximum.accumulate(edges[order[:-1], 1])).all():
        return
    robot, source = log
    open_: list[tuple[int, int]] = []
    for (start, stop), number in zip(edges[order].tolist(), numbers[order].tolist(), strict=True):
        open_ = [(end, other) for end, other in open_ if end > start]
        for end, other in open_:
            if other != number:
                yield (
                    number,
                    other,
                    f"rows {start} to {min(end, stop) - 1} of the {source} of robot {robot} stand in both submap "
                    f"{submaps[other].id} and submap {submaps[number].id}; joined, they would count twice and "
                    f"the map would be too sure of itself; where they are of two drives of one robot, it needs a "
                    f"name and a number of its own in the second log",
                )
        open_.append((stop, number))


def priors_in_several(submaps: Sequence[Submap]) -> Iterable[Conflict]:
    """Each submap that brings a landmark's absolute measurement which one before it brings too: in every number and in
    its noise the same."""
    seen: dict[tuple[int, bytes, bytes], int] = {}
    for number, submap in enumerate(submaps):
        for table in submap.raw:
            if not table.row.unary:
                continue
            for row in np.flatnonzero(is_landmark(table.keys[:, 0])).tolist():
                noise = table.whitening[row if len(table.whitening) > 1 else 0]
                key = int(table.keys[row, 0])
                other = seen.setdefault((key, table.values[row].tobytes(), noise.tobytes()), number)
                if other != number:
                    yield (
                        number,
                        other,
                        f"submap {submaps[other].id} and submap {submap.id} both bring the same prior on "
                        f"{submap.names.describe(key)}; joined, one survey would count twice; let one robot bring it",
                    )
