"""Logs as they arrive: the rows of each time, and the same out of order, twice and late."""

from collections.abc import Sequence

import numpy as np

from teamslam.model import Dataset, Table, index_of, robot_of


def in_time(log: Dataset, robot: int) -> list[tuple[int, list[Table]]]:
    """The rows of one robot's log by the tick at which each was measured: of a row between two of its own poses, the
    later."""
    rows: dict[int, list[Table]] = {}
    for table in log.of_robot(robot).tables:
        own = robot_of(table.keys) == robot
        ticks = np.where(own, index_of(table.keys), -1).max(1)
        for tick in np.unique(ticks).tolist():
            rows.setdefault(tick, []).append(table.select(ticks == tick))
    return sorted(rows.items())


def shaken(moments: Sequence[tuple[int, list[Table]]], horizon: int, rng: np.random.Generator) -> list[Table]:
    """Single rows in another order in which none comes later than `horizon` ticks after the newest before it; some come
    twice."""
    single = [(tick, table.select([n])) for tick, tables in moments for table in tables for n in range(len(table))]
    due = [tick + float(rng.uniform(0.0, horizon)) for tick, _ in single]
    late = [row for _, (_, row) in sorted(zip(due, single, strict=True), key=lambda pair: pair[0])]
    out = []
    for row in late:
        out += [row] * (2 if rng.random() < 0.2 else 1)
    return out
