"""Tags of which the size is stated wrongly: larger or smaller than it is, their poses come out too far or too near.

Each landmark that costs too much and is seen by the corners of one tag is placed again with its corners nearer to its
middle or farther from it, the rest of the map held, over a grid of sizes. Such a tag bends the map, which then holds it
near what is stated; so from the best of them the whole map is solved again and again, downhill as far as that leads. A
size is told where that takes away most of the landmark's excess, beside the map that is solved again by the size as it
is stated: a join may be far from its best by itself.

Before that all tags are tried together: where odometry or depths say how long a metre is, one wrong edge for all of
them bends every row a little, and no tag by itself costs too much.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import IntArray
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.model import Dataset, Submap, Table, Values, index_of, told_by
from teamslam.solver import Options, System, firm, optimise
from teamslam.trust.cause import Cause
from teamslam.trust.residuals import Rows
from teamslam.trust.tally import by_landmark

SUSPECT, EXCESS = 3.0, 50.0  # times the expected cost, and how much above it, from which a landmark is looked at
FARTHEST, STEP = 1.0, 0.03  # of the logarithm of a size, and of its grid
AROUND, FINER, FINEST = 0.1, 20, 0.02  # first steps from there on the whole map, trials there, and of them the share
LEAST = 0.02  # of a size: what is nearer is another fault
LARGEST = 0.5  # of a size of all tags: what is farther is a unit
EXPLAINED = 0.8  # of the landmark's excess
MOST = 5  # landmarks
HINT, HINTED = 0.03, 0.2  # sizes of all to both sides; of the excess, what a parabola through them has to take away
QUICK = Options(max_iterations=15, decrement=0.1)


def wrong_size_of_all(log: Dataset, joined: Submap, rows: Sequence[Rows]) -> list[Cause]:
    """Whether all tags of a map are so many times larger or smaller than stated, in words."""
    values, frame = point_of(joined), frame_of(joined)
    tables = told_by(log.tables, values.layout)
    corners = [table for table in tables if table.model == "corners" and len(table)]
    marks = np.unique(np.concatenate([np.zeros(0, np.int64), *(table.keys[:, -1] for table in corners)]))
    excess = float(sum(row.cost.sum() - row.expected.sum() for row in rows))
    if len(marks) < 2 or excess < EXCESS:
        return []

    def whole(size: float) -> float:
        return _cost(*_solved([_resized(table, marks, size) for table in tables], values, frame))

    stated = whole(0.0)
    smaller, larger = whole(-HINT), whole(HINT)
    bent, slope = 0.5 * (smaller + larger) - stated, 0.5 * (larger - smaller)
    if bent > 0.0 and slope**2 / (4.0 * bent) < HINTED * excess:
        return []
    size, after = _lowest(whole, 0.0)
    gone = (stated - after) / excess
    if not LEAST < abs(size) < LARGEST or gone < EXPLAINED:
        return []
    edges = {edge for mark in marks.tolist() if (edge := _edge(_of(mark, tables))) is not None}
    example = f" ({min(edges):.3f} m would be {min(edges) * np.exp(size):.3f} m)" if edges else ""
    said = (
        f"the size of all tags is wrong: they fit {np.exp(size):.3f} times as large as they are stated{example}; or "
        f"else what tells metres besides, odometry before all, has lengths {np.exp(-size):.3f} times too long"
    )
    robots = tuple(sorted({table.robot for table in corners}))
    return [Cause("size", said, min(gone, 1.0), robots, partial(_by_size, mark=marks, size=size))]


def wrong_sizes(log: Dataset, joined: Submap, rows: Sequence[Rows]) -> list[Cause]:
    """The tags of a map whose size is stated wrongly, in words; `rows` are the residuals at it."""
    tally = by_landmark(rows)
    due = np.maximum(tally.expected, 1.0)
    excess = tally.cost - due
    bad = np.flatnonzero((excess > EXCESS) & (tally.cost > SUSPECT * due))
    values = point_of(joined)
    tables = told_by(log.tables, values.layout)
    found: list[Cause] = []
    for k in bad[np.argsort(-excess[bad])][:MOST].tolist():
        mark = int(tally.labels[k])
        edge = _edge(_of(mark, tables))
        if edge is None:
            continue
        frame = frame_of(joined)
        size, after = _best(tables, values, mark, frame)
        gone = (_cost(*_solved(tables, values, frame)) - after) / excess[k]
        if abs(size) > LEAST and gone > EXPLAINED:
            tag, robots = log.names.landmark(int(index_of(mark))), {t.robot for t in _of(mark, tables)}
            said = (
                f"the size of tag {tag} is wrong: {edge:.3f} m is stated, and it fits with {edge * np.exp(size):.3f} m"
            )
            mend = partial(_by_size, mark=mark, size=size)
            found.append(Cause("size", said, min(gone, 1.0), tuple(sorted(robots)), mend))
    return found


def _best(tables: Sequence[Table], values: Values, mark: int, frame: IntArray) -> tuple[float, float]:
    """By what factor (its logarithm) a tag's size fits best, and what the whole map costs then."""
    grid = np.arange(-FARTHEST, FARTHEST, STEP)
    mine = _of(mark, tables)
    keys = np.unique(np.concatenate([t.keys.ravel() for t in mine]))
    alone = [_cost(*_solved([_resized(t, mark, s) for t in mine], values.only(keys), keys[keys != mark])) for s in grid]
    start = float(grid[int(np.argmin(alone))])

    def whole(size: float) -> float:
        return _cost(*_solved([_resized(t, mark, size) for t in tables], values, frame))

    return _lowest(whole, start)


def _lowest(whole: Callable[[float], float], start: float) -> tuple[float, float]:
    """Where a cost is lowest near a start, and what it is there."""
    from scipy.optimize import minimize_scalar

    fit = minimize_scalar(whole, bracket=(start - AROUND, start + AROUND), options={"maxiter": FINER, "xtol": FINEST})
    return float(fit.x), float(fit.fun)


def _of(mark: int, tables: Sequence[Table]) -> list[Table]:
    """The rows of corners on a landmark."""
    return [part for t in tables if t.model == "corners" and len(part := t.select(t.keys[:, -1] == mark))]


def _edge(mine: Sequence[Table]) -> float | None:
    """The edge of the one square that all rows see [m]; None where they see others, or none."""
    if not mine:
        return None
    corners = np.concatenate([t.values[:, 12:24] for t in mine])
    if not np.allclose(corners, corners[0]):
        return None
    return float(np.linalg.norm(corners[0, 3:6] - corners[0, :3]))


def _solved(tables: Sequence[Table], values: Values, fixed: IntArray) -> tuple[Sequence[Table], Values]:
    """The tables, and the map that fits them best; the one at hand where that cannot be solved."""
    try:
        system = System(values.layout, tables=tables, fixed=fixed)
        return tables, firm(system, optimise(system, values, QUICK)).values
    except TeamslamError:
        return tables, values


def _cost(tables: Sequence[Table], values: Values) -> float:
    return sum(table.cost(values) for table in tables)


def _by_size(log: Dataset, mark: int | IntArray, size: float) -> Dataset:
    """The log with a tag, or several, of another size."""
    return log.with_tables(_resized(table, mark, size) for table in log.tables)


def _resized(table: Table, mark: int | IntArray, size: float) -> Table:
    """A table with the corners on one landmark or several so much (a logarithm) farther from their middle."""
    if table.model != "corners":
        return table
    corners = table.values[:, 12:24].reshape(-1, 4, 3)
    middle = corners.mean(1, keepdims=True)
    far = np.where(np.isin(table.keys[:, -1], mark), np.exp(size), 1.0)[:, None, None]
    out = (middle + far * (corners - middle)).reshape(-1, 12)
    return replace(table, values=np.concatenate([table.values[:, :12], out], -1))
