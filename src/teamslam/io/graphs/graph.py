"""Graphs of sightings, read edge by edge, as tables: what the readers of factor-graph files share.

An edge belongs to the robot whose pose it starts from (a surveyed landmark: to the lowest robot that sees it). Tables
are named by what they see: `odometry` (from a robot's pose to its next one), `loops` (between other poses of one
robot), `robots`, `landmarks`, and `world` (absolute measurements). Rows are numbered for each robot and source in the
order of the file.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import Array, Pose
from teamslam.model import (
    MODELS,
    Dataset,
    Kind,
    Layout,
    Table,
    Values,
    is_landmark,
    is_pose,
    robot_of,
)


class Place(Protocol):
    """Where an edge stands in its file: a maker of errors that say so."""

    def error(self, problem: str, field: str | None = None) -> InputError:
        """An InputError at this place."""
        ...


@dataclass(frozen=True)
class Edge:
    """One measurement as a file states it: model and dimension as in MODELS, the keys, the value, the noise matrix (in
    the file's own convention), and where it stands. `sensor` is the place of its sensor's pose among all."""

    model: str
    dim: int
    keys: tuple[int, ...]
    value: tuple[float, ...]
    noise: Array
    place: Place
    sensor: int | None = None


Whitener = Callable[[str, int, Array, Array], Array]
"""(model, dim, values (m, size), noise (m, r, r)) -> whitening (m, r, r); ModelError names the row at fault."""


def tables_of(edges: Sequence[Edge], whitener: Whitener, sensors: Sequence[Pose] = ()) -> tuple[Table, ...]:
    """The edges as tables, one for each robot, source, model, dimension and sensor, in order of appearance.

    InputError names the line of a noise matrix that is none.
    """
    following, watchers = _following(edges), _watchers(edges)
    groups: dict[tuple[int, str, str, int, int | None], list[int]] = {}
    numbers: dict[tuple[int, str], int] = {}
    ids = np.zeros(len(edges), np.int64)
    for k, edge in enumerate(edges):
        source = _source(edge, following)
        robot = int(robot_of(edge.keys[0])) or watchers.get(edge.keys[0], min(watchers.values(), default=1))
        groups.setdefault((robot, source, edge.model, edge.dim, edge.sensor), []).append(k)
        ids[k] = numbers.get((robot, source), 0)
        numbers[robot, source] = int(ids[k]) + 1
    tables = []
    for (robot, source, model, dim, sensor), rows in groups.items():
        values = np.array([edges[k].value for k in rows])
        try:
            whitening = whitener(model, dim, values, np.stack([edges[k].noise for k in rows]))
        except ModelError as error:
            raise _at_fault(error, [edges[k] for k in rows], whitener) from None
        tables.append(
            Table(
                robot=robot,
                source=source,
                model=model,
                dim=dim,
                keys=np.array([edges[k].keys for k in rows], np.int64),
                values=values,
                whitening=whitening,
                ids=ids[rows],
                sensor=None if sensor is None else sensors[sensor],
            )
        )
    return tuple(tables)


def _at_fault(error: ModelError, edges: Iterable[Edge], whitener: Whitener) -> InputError:
    """The error of a batch as one of its first bad line."""
    for edge in edges:
        try:
            whitener(edge.model, edge.dim, np.array([edge.value]), edge.noise[None])
        except ModelError as single:
            return edge.place.error(str(single).replace(" 0 ", " "))
    return InputError(str(error))


def _following(edges: Iterable[Edge]) -> dict[int, int]:
    """Each robot pose's next pose of the same robot."""
    keys = np.unique(np.array([key for edge in edges for key in edge.keys], np.int64))
    poses = keys[is_pose(keys)]
    same = robot_of(poses[1:]) == robot_of(poses[:-1])
    return dict(zip(poses[:-1][same].tolist(), poses[1:][same].tolist(), strict=True))


def _watchers(edges: Iterable[Edge]) -> dict[int, int]:
    """The lowest robot that sees each landmark."""
    found: dict[int, int] = {}
    for edge in edges:
        if len(edge.keys) == 2:
            robot = int(robot_of(edge.keys[0]))
            found[edge.keys[1]] = min(robot, found.get(edge.keys[1], robot))
    return found


def _source(edge: Edge, following: dict[int, int]) -> str:
    if MODELS[edge.model].unary:
        return "world"
    first, second = edge.keys
    if is_landmark(second):
        return "landmarks"
    if robot_of(first) != robot_of(second):
        return "robots"
    return "odometry" if edge.model == "relative_pose" and following.get(first) == second else "loops"


def robots_of(edges: Iterable[Edge], names: Mapping[int, str]) -> dict[int, int]:
    """The robots that edges name and the dimension each moves in. InputError for one that does both."""
    dims: dict[int, int] = {}
    for edge in edges:
        for robot in robot_of(np.array(edge.keys, np.int64)).tolist():
            if robot > 0 and dims.setdefault(robot, edge.dim) != edge.dim:
                raise edge.place.error(f"robot {names.get(robot, robot)} has poses in the plane and in space")
    return dict(sorted(dims.items()))


def matching(values: Values | None, dataset: Dataset) -> tuple[Values | None, int]:
    """The values of the dataset's own variables and kinds (None for none), and how many others there were."""
    if values is None:
        return None, 0
    layout = dataset.layout
    known = layout.contains(values.layout.keys)
    known[known] = layout.kinds[layout.index(values.layout.keys[known])] == values.layout.kinds[known]
    kept = values.select(known)
    return (kept if len(kept) else None), int((~known).sum())


def values_of(found: dict[int, tuple[Kind, Sequence[float]]]) -> Values | None:
    """Values from rows of the state vector by key; None for no rows."""
    if not found:
        return None
    keys = np.array(list(found), np.int64)
    layout = Layout.of(keys, np.array([int(kind) for kind, _ in found.values()]))
    state = np.zeros(int(layout.state_start[-1]))
    at = layout.index(keys)
    for start, (_, row) in zip(layout.state_start[at], found.values(), strict=True):
        state[start : start + len(row)] = row
    return Values(layout, state)


def parts_of(dataset: Dataset) -> list[tuple[Table, tuple[Kind, ...]]]:
    """The tables, each cut into parts that are about variables of the same kinds, with these kinds; none is empty."""
    parts = []
    for table in dataset.tables:
        kinds = dataset.layout.kinds[dataset.layout.index(table.keys)]
        for row in np.unique(kinds, axis=0):
            same = (kinds == row).all(1)
            parts.append((table if same.all() else table.select(same), tuple(Kind(kind) for kind in row.tolist())))
    return parts


def no_word_for(table: Table, ends: Sequence[Kind], format: str, others: str) -> InputError:
    """The error of a writer whose format cannot hold a table; `others` can."""
    sensor = " by a sensor off the body's origin" if table.sensor is not None else ""
    return InputError(
        f"{format} has no word for {table.source} ({table.model}, {table.dim}D, "
        f"{' to '.join(end.name for end in ends)}){sensor}; write {others}"
    )
