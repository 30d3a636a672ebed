"""Robots taken for others: all sightings of one robot by another fit a third.

    screen     at the team's map, what does each robot's sightings of each other cost?
    blind      where they cost too much: the map without that robot's sightings of robots, in which nothing is bent
    compare    the same rows as sightings of every other robot, at the pose nearest in time

The robot that fits is told where the rows fit it as they should, and the one that they name not at all.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import Joined, build, split
from teamslam.joining.exact.gap import point_of
from teamslam.model import Dataset, Submap, Table, Values, chi2_quantile, index_of, is_pose, pose_key, robot_of
from teamslam.solver import Options
from teamslam.trust.influence.removal import without

FEWEST = 4  # sightings of one robot by another
BAD, GOOD = 25.0, 6.0  # times the median of chi-square: what fits not at all, and as it should
BETTER = 25.0  # times better that the right robot fits at least
CAP = 50.0  # of a squared residual: what is more is as bad
QUICK = Options(max_iterations=60, decrement=0.1, elsewhere=False)  # medians of residuals are asked
NEAR = 0.6  # of a usual step between poses: how far in time a pose may be from a sighting


@dataclass(frozen=True, eq=False)
class Mistaken:
    """Robot `by` calls robot `right` by the name of robot `named`, in so many `rows`; `odds`: natural logarithm."""

    by: int
    named: int
    right: int
    rows: int
    odds: float


def mistaken_robots(log: Dataset, submaps: Sequence[Submap], joined: Joined) -> list[Mistaken]:
    """The robots that some robot takes for others; `joined` is the map of the submaps of a log.

    Law: where each robot's sightings of each other fit as stated, nobody is looked at twice.
    """
    found = []
    for robot in sorted(log.robots):
        doubted = [named for named, cost in _costs(log, robot, joined) if cost > BAD]
        blind = _without_sightings(log, robot, submaps, joined) if doubted else None
        if blind is not None:
            here = [right for named in doubted if (right := _right(log, robot, named, blind)) is not None]
            found += [*here, *_the_other_way(log, here, blind)]
    return found


def _the_other_way(log: Dataset, mistakes: Sequence[Mistaken], values: Values) -> Iterator[Mistaken]:
    """Who takes one robot for another is likely to take the other for the one: then few sightings tell."""
    for mistake in mistakes:
        if all(mistake.right != other.named for other in mistakes):
            back = _right(log, mistake.by, mistake.right, values, among=(mistake.named,), fewest=1)
            if back is not None:
                yield back


def put_right(table: Table, log: Dataset, mistakes: Sequence[Mistaken]) -> Table:
    """A table with the robots called by their names; rows at whose instant the right robot has no pose are left out,
    as its place then is not known."""
    keys, known = table.keys.copy(), np.ones(len(table), bool)
    for mistake in mistakes:
        rows = _of(table, mistake.by, mistake.named)
        if len(rows):
            right = pose_key(mistake.right, index_of(table.keys[rows, 1]))
            keys[rows, 1] = right
            known[rows] = np.isin(right, log.pose_keys[mistake.right]) & _can_name(table, log, mistake.right)
    return replace(table, keys=keys).select(known) if (keys != table.keys).any() else table


def _costs(log: Dataset, robot: int, joined: Joined) -> Iterator[tuple[int, float]]:
    """Whom a robot names in its sightings, and what these cost at the map: their median over what it should be."""
    maps = [point_of(component.map) for component in joined.components]
    named, sizes = [np.zeros(0, np.int64)], [np.zeros(0)]
    for table in log.tables:
        if table.robot != robot or table.row.unary or table.source == "odometry":
            continue
        for values in maps:
            part = table.select(_others(table, robot))
            part = part.select(np.asarray(values.layout.contains(part.keys).all(1)))
            if len(part):
                named.append(robot_of(part.keys[:, 1]))
                sizes.append(_over_median(part, values))
    who, size = np.concatenate(named), np.concatenate(sizes)
    for other in np.unique(who).tolist():
        if np.count_nonzero(who == other) >= FEWEST:
            yield other, float(np.median(size[who == other]))


def _over_median(table: Table, values: Values) -> Array:
    """The squared residuals (m,) of rows, over the median of chi-square."""
    return np.asarray(np.sum(table.whitened(values) ** 2, -1) / chi2_quantile(0.5, np.maximum(table.ranks, 1)))


def _right(
    log: Dataset, robot: int, named: int, values: Values, *, among: Collection[int] = (), fewest: int = FEWEST
) -> Mistaken | None:
    """The robot that is meant, if it is plainly another: of some, or of all."""
    as_named = _sizes(log, robot, named, named, values)
    others = {other: _sizes(log, robot, named, other, values) for other in set(among or log.robots) - {robot, named}}
    others = {other: sizes for other, sizes in others.items() if 2 * len(sizes) >= len(as_named) >= fewest}
    if not others:
        return None
    right = min(others, key=lambda other: float(np.median(others[other])))
    size, was = float(np.median(others[right])), float(np.median(as_named))
    if size > GOOD or was < BETTER * max(size, 1.0):
        return None
    noise = max(size, 1.0)
    spent = [float(np.minimum(s / noise, CAP).sum()) for s in (as_named, others[right])]
    return Mistaken(robot, named, right, len(as_named), 0.5 * (spent[0] - spent[1]))


def _sizes(log: Dataset, robot: int, named: int, other: int, values: Values) -> Array:
    """Squared residuals of a robot's sightings of one that it names, as if they were of another, over the median of
    chi-square; of those that the map knows both poses of."""
    found = [np.zeros(0)]
    for table in log.tables:
        rows = _of(table, robot, named)
        if not len(rows) or not _can_name(table, log, other):
            continue
        part = table.select(rows)
        keys, known = _at_its_time(part.keys, other, values)
        part = replace(part, keys=keys).select(known)
        if len(part):
            found.append(_over_median(part, values))
    return np.concatenate(found)


def _can_name(table: Table, log: Dataset, robot: int) -> bool:
    """Whether rows of a table may be sightings of a robot: those of the plane are of none that moves in space."""
    return log.robots[robot] <= table.dim


def _at_its_time(keys: IntArray, other: int, values: Values) -> tuple[IntArray, BoolArray]:
    """Keys (m, 2) with the pose of another robot that is nearest in time as target, and which of them are known and
    near enough (m,)."""
    poses = values.layout.keys[robot_of(values.layout.keys) == other]
    known = np.asarray(values.layout.contains(keys[:, 0]))
    if len(poses) < 2:
        return keys, np.zeros(len(keys), bool)
    ticks, wanted = np.sort(index_of(poses)), index_of(keys[:, 1])
    after = np.clip(np.searchsorted(ticks, wanted), 1, len(ticks) - 1)
    nearest = np.where(wanted - ticks[after - 1] < ticks[after] - wanted, ticks[after - 1], ticks[after])
    near = np.abs(nearest - wanted) <= NEAR * float(np.median(np.diff(ticks)))
    return np.stack([keys[:, 0], pose_key(other, nearest)], -1), known & near


def _of(table: Table, robot: int, named: int) -> IntArray:
    """The rows of a table in which a robot names another."""
    if table.robot != robot or table.row.unary or table.source == "odometry":
        return np.zeros(0, np.int64)
    target = table.keys[:, 1]
    return np.flatnonzero(is_pose(target) & (robot_of(target) == named))


def _without_sightings(log: Dataset, robot: int, submaps: Sequence[Submap], joined: Joined) -> Values | None:
    """The map in which a robot saw no others, from where the team's map has all; None where it then hangs on
    nothing."""
    own = [table for table in log.tables if table.robot == robot]
    kept = [table.select(~np.isin(np.arange(len(table)), _others(table, robot))) for table in own]
    rest = [submap for submap in submaps if int(robot_of(submap.base)) != robot]
    near = point_of(joined.map) if len(joined.components) == 1 else None
    try:
        blind = [build(piece) for piece in split(log.with_tables(table for table in kept if len(table)))]
        maps = without([*rest, *blind], joined, (), near=near, options=QUICK).maps
    except TeamslamError:
        return None
    return next((point_of(m) for m in maps if robot in m.robots_in_it), None)


def _others(table: Table, robot: int) -> IntArray:
    target = table.keys[:, -1]
    return np.flatnonzero(is_pose(target) & (robot_of(target) != robot))
