"""Measurements said in other words, for formats that lack the word: what a writer of graphs can still hold.

    at_body            a sensor's measurement moved into the body's frame: exact for points and relative poses
    as_points          range and bearing as a point, to first order at the measurement
    as_range_bearing   a point as range and bearing, to first order at the measurement
    as_relative_pose   where a robot is as its relative pose, with no information about its turn: exact

With J = d point / d (range, bearing) at the measurement, W_point = W J^-1 and W = W_point J.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, direction_basis
from teamslam.model import Dataset, Dropped, Kind, Table, pack
from teamslam.model.sensors import pose_of

NEAREST = 1e-6  # [m]: a range below this has no bearing, nor a point at it one

HasWord = Callable[[Table, tuple[Kind, ...]], bool]
Part = tuple[Table, tuple[Kind, ...]]


def reworded(dataset: Dataset, has_word: HasWord) -> tuple[list[Part], list[Part], list[Dropped]]:
    """The tables cut into parts about variables of the same kinds, each in words that the format has; those that it
    has no words for; and what was said in other words, counted."""
    parts: list[Part] = []
    without: list[Part] = []
    counts: dict[str, int] = {}
    for table, ends in parts_of(dataset):
        found = next(((said, other) for said, other in _wordings(table, ends) if has_word(other, ends)), None)
        if found is None:
            without.append((table, ends))
            continue
        said, other = found
        parts.append((other, ends))
        for reason in said:
            counts[reason] = counts.get(reason, 0) + len(table)
    return parts, without, [Dropped(count, reason) for reason, count in counts.items()]


def parts_of(dataset: Dataset) -> list[Part]:
    """The tables, each cut into parts that are about variables of the same kinds, with these kinds; none is empty."""
    parts = []
    for table in dataset.tables:
        kinds = dataset.layout.kinds[dataset.layout.index(table.keys)]
        code = kinds @ len(Kind) ** np.arange(kinds.shape[1])[::-1]
        for one, first in zip(*np.unique(code, return_index=True), strict=True):
            same, ends = code == one, tuple(Kind(kind) for kind in kinds[first].tolist())
            parts.append((table if same.all() else table.select(same), ends))
    return parts


def no_word_for(parts: Sequence[Part], format: str) -> str | None:
    """What a format has no word for, in words; None where there is nothing."""
    if not parts:
        return None
    table, ends = parts[0]
    sensor = " by a sensor off the body's origin" if table.sensor is not None else ""
    others = f" and {len(parts) - 1} more" if len(parts) > 1 else ""
    return (
        f"{format} has no word for {table.source} ({table.model}, {table.dim}D, "
        f"{' to '.join(end.name for end in ends)}){sensor}{others}"
    )


def _wordings(table: Table, ends: tuple[Kind, ...]) -> Iterator[tuple[tuple[str, ...], Table]]:
    """The ways to say a table, the plainest first, with what is to be told of each."""
    yield (), table
    movable = table.sensor is None or table.sensor.dim <= table.dim
    if table.sensor is not None and movable and table.model in ("point", "relative_pose"):
        yield ("measurements by a sensor off the body: written as seen from the body, exactly",), at_body(table)
    points, told = table, []
    if table.model == "range_bearing" and (table.values[:, 0] > NEAREST).all():
        told = ["ranges with bearings: written as points with their covariance, to first order"]
        points = as_points(table)
        yield tuple(told), points
        if table.sensor is not None and movable:
            yield tuple(told), at_body(points)
    if points.model == "point" and movable and ends[-1].is_pose:
        open_turn = "sightings of where robots are: written as relative poses without information about turns, exactly"
        yield (*told, open_turn), as_relative_pose(at_body(points))
    if table.model == "point" and movable:
        points = at_body(table)
        if (np.linalg.norm(points.values, axis=1) > NEAREST).all():
            yield (
                ("points: written as ranges with bearings and their covariance, to first order",),
                as_range_bearing(points),
            )


def at_body(table: Table) -> Table:
    """A sensor's points or relative poses as seen from the body; the sensor is of no higher dimension than the rows.
    Law: the whitened residuals have the same length."""
    if table.sensor is None:
        return table
    sensor = table.sensor.lift(table.dim)
    turn = np.eye(table.row.residual_rows(table.dim))
    turn[: table.dim, : table.dim] = sensor.rotation.T
    is_point = table.model == "point"
    values = sensor.act(table.values) if is_point else pack(sensor @ pose_of(table.values, table.dim))
    return replace(table, values=values, whitening=table.whitening @ turn, sensor=None)


def as_points(table: Table) -> Table:
    """Ranges with bearings as points."""
    distance, direction = table.values[:, :1], _directions(table)
    whitening = table.whitening @ np.linalg.inv(_slopes(distance, direction))
    return replace(table, model="point", values=distance * direction, whitening=whitening)


def as_range_bearing(table: Table) -> Table:
    """Points as ranges with bearings. Law: as_points of it are the points again."""
    distance = np.linalg.norm(table.values, axis=1, keepdims=True)
    direction = table.values / distance
    bearing = direction if table.dim == 3 else np.arctan2(direction[:, 1:], direction[:, :1])
    values = np.concatenate([distance, bearing], -1)
    return replace(
        table, model="range_bearing", values=values, whitening=table.whitening @ _slopes(distance, direction)
    )


def as_relative_pose(table: Table) -> Table:
    """Points that are robots' places as relative poses that leave the turn open. Law: they cost the same everywhere."""
    m, d, rows = len(table), table.dim, 3 * table.dim - 3
    whitening = np.zeros((m, rows, rows))
    whitening[:, :d, :d] = table.whitening
    turns = np.broadcast_to(np.eye(d).ravel(), (m, d * d))
    return replace(table, model="relative_pose", values=np.concatenate([table.values, turns], -1), whitening=whitening)


def _directions(table: Table) -> Array:
    if table.dim == 3:
        return table.values[:, 1:]
    return np.concatenate([np.cos(table.values[:, 1:]), np.sin(table.values[:, 1:])], -1)


def _slopes(distance: Array, direction: Array) -> Array:
    """J (m, d, d) of points by range and bearing."""
    if direction.shape[1] == 3:
        across = direction_basis(direction)
    else:
        across = np.stack([-direction[:, 1:], direction[:, :1]], 1)
    return np.concatenate([direction[:, :, None], distance[:, :, None] * across], -1)
