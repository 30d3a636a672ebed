"""Which rows of which logs went into a submap, so that nothing is ever counted twice."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import BoolArray, IntArray, read_only
from teamslam.model.tables import Table

Log = tuple[int, str]
"""A robot and what it told of ('odometry', 'landmarks', ...)."""


@dataclass(frozen=True, order=True)
class Stretch:
    """Rows start..stop (stop not included) of one robot's log of one source ('odometry', 'landmarks', ...)."""

    robot: int
    source: str
    start: int
    stop: int


class Sources:
    """Which rows of which logs: a set of disjoint stretches, in order.

    `edges`: of each log the stretches' first rows and the rows after their last (n, 2), rising.
    """

    def __init__(self, stretches: Iterable[Stretch] = ()) -> None:
        logs: dict[Log, set[tuple[int, int]]] = {}
        for s in stretches:
            logs.setdefault((s.robot, s.source), set()).add((s.start, s.stop))
        self.edges: Mapping[Log, IntArray] = _in_order(
            {log: np.array(sorted(edges), np.int64) for log, edges in logs.items()}
        )

    @classmethod
    def by_edges(cls, edges: Mapping[Log, IntArray]) -> "Sources":
        """The stretches of each log, given as `edges` has them."""
        made = cls()
        made.edges = _in_order({log: own for log, own in edges.items() if len(own)})
        return made

    @classmethod
    def of(cls, tables: Iterable[Table]) -> "Sources":
        """The rows that some tables hold, as few stretches as there can be: equal rows make equal sources."""
        rows: dict[Log, list[IntArray]] = {}
        for table in tables:
            rows.setdefault((table.robot, table.source), []).append(table.ids)
        return cls.by_edges({log: _runs(np.concatenate(parts)) for log, parts in rows.items()})

    def rows_of(self, table: Table) -> BoolArray:
        """Which rows (m,) of a table are among them."""
        mine = self.edges.get((table.robot, table.source))
        if mine is None:
            return np.zeros(len(table), bool)
        at = np.searchsorted(mine[:, 0], table.ids, side="right") - 1
        return np.asarray((at >= 0) & (table.ids < mine[np.maximum(at, 0), 1]))

    def overlap(self, other: "Sources") -> Stretch | None:
        """A stretch that stands in both, or None: what would be counted twice."""
        for log, theirs in other.edges.items():
            if (mine := self.edges.get(log)) is None:
                continue
            # The first of mine that ends after one of theirs begins overlaps it, or none does.
            first = np.searchsorted(mine[:, 1], theirs[:, 0], side="right")
            starts = np.concatenate([mine[:, 0], [np.iinfo(np.int64).max]])[first]
            for n in np.flatnonzero(starts < theirs[:, 1])[:1].tolist():
                start, stop = np.maximum(mine[first[n], 0], theirs[n, 0]), np.minimum(mine[first[n], 1], theirs[n, 1])
                return Stretch(*log, int(start), int(stop))
        return None

    def merge(self, *others: "Sources") -> "Sources":
        """All rows of several disjoint sets, neighbouring stretches made one."""
        logs: dict[Log, list[IntArray]] = {}
        for sources in (self, *others):
            for log, edges in sources.edges.items():
                logs.setdefault(log, []).append(edges)
        return Sources.by_edges({log: _merged(np.concatenate(parts)) for log, parts in logs.items()})

    def __iter__(self) -> Iterator[Stretch]:
        return (Stretch(*log, start, stop) for log, edges in self.edges.items() for start, stop in edges.tolist())

    def __len__(self) -> int:
        return sum(map(len, self.edges.values()))

    def __eq__(self, other: object) -> bool:
        return self._bytes == other._bytes if isinstance(other, Sources) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._bytes)

    def __repr__(self) -> str:
        rows = sum(int((edges[:, 1] - edges[:, 0]).sum()) for edges in self.edges.values())
        return f"Sources({rows:,} rows of {len(self.edges)} logs)"

    @cached_property
    def _bytes(self) -> tuple[tuple[Log, bytes], ...]:
        return tuple((log, edges.tobytes()) for log, edges in self.edges.items())


def _in_order(edges: Mapping[Log, IntArray]) -> dict[Log, IntArray]:
    return {log: read_only(np.ascontiguousarray(edges[log], np.int64)) for log in sorted(edges)}


def _runs(ids: IntArray) -> IntArray:
    """The stretches (n, 2) of rows that follow each other."""
    if not (np.diff(ids) > 0).all():
        ids = np.unique(ids)
    last = np.append(np.flatnonzero(np.diff(ids) != 1), len(ids) - 1)
    first = np.append(0, last[:-1] + 1)
    return np.stack([ids[first], ids[last] + 1], -1) if len(ids) else np.zeros((0, 2), np.int64)


def _merged(edges: IntArray) -> IntArray:
    """Disjoint stretches (n, 2) in order, neighbours made one."""
    edges = np.unique(edges, axis=0)
    apart = np.flatnonzero(edges[1:, 0] != edges[:-1, 1])
    return np.stack([edges[np.append(0, apart + 1), 0], edges[np.append(apart, len(edges) - 1), 1]], -1)
