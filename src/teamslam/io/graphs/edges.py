"""Measurements between named variables as tables: what the readers of factor-graph files share.

A measurement belongs to the robot whose pose it starts from (a surveyed landmark: to the lowest robot that sees it).
Tables are named by what they see: `odometry` (between a robot's pose and its next one, either way), `loops` (between
other poses of one robot), `robots`, `landmarks`, and `world` (absolute measurements). Rows are numbered for each robot
and source in the order of the file.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import AnyArray, Array, IntArray, Pose
from teamslam.model import MODELS, Dataset, Kind, Table, Values, is_landmark, is_pose, robot_of

SOURCES = ("world", "landmarks", "robots", "odometry", "loops")
Fail = Callable[[int, str], InputError]
"""(row, problem) -> the error to raise about it, which says where it stands."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Measurements of one model and dimension, as MODELS and Table have them: `keys` (m, k), `values` (m, size),
    `whitening` (m, r, r). `order` (m,) are their places in the log; `sensor` (m,) the places of their sensors' poses
    among all, -1 for the body; `fail` makes an error that says where a row stands."""

    model: str
    dim: int
    keys: IntArray
    values: Array
    whitening: Array
    order: IntArray
    sensor: IntArray
    fail: Fail

    def __len__(self) -> int:
        return len(self.keys)

    def select(self, rows: AnyArray) -> "Edges":
        """The rows at a mask or index."""
        places = np.arange(len(self))[rows]
        arrays = {name: getattr(self, name)[places] for name in ("keys", "values", "whitening", "order", "sensor")}
        return replace(self, **arrays, fail=lambda row, problem: self.fail(int(places[row]), problem))


def tables_of(edges: Sequence[Edges], sensors: Sequence[Pose] = ()) -> tuple[Table, ...]:
    """The measurements as tables, one for each robot, source, model, dimension and sensor, in order of appearance."""
    edges = [part for part in edges if len(part)]
    if not edges:
        return ()
    poses, watchers = _poses(edges), _watchers(edges)
    robots = [_robots(part, watchers) for part in edges]
    sources = [_sources(part, poses) for part in edges]
    numbers = _numbers(robots, sources, [part.order for part in edges])
    groups: dict[tuple[int, int, str, int, int], list[tuple[int, IntArray]]] = {}
    for number, part in enumerate(edges):
        told = np.stack([robots[number], sources[number], part.sensor], -1)
        kinds, which = np.unique(told, axis=0, return_inverse=True)
        for k, (robot, source, sensor) in enumerate(kinds.tolist()):
            group = (robot, source, part.model, part.dim, sensor)
            groups.setdefault(group, []).append((number, np.flatnonzero(which.ravel() == k)))
    found = []
    for (robot, source, model, dim, sensor), members in groups.items():
        order = np.concatenate([edges[number].order[rows] for number, rows in members])
        by_place = np.argsort(order, kind="stable")

        keys, values, whitening = (
            np.concatenate([getattr(edges[n], name)[rows] for n, rows in members])[by_place]
            for name in ("keys", "values", "whitening")
        )
        ids = np.concatenate([numbers[number][rows] for number, rows in members])[by_place]
        pose = None if sensor < 0 else sensors[sensor]
        table = Table(robot, SOURCES[source], model, dim, keys, values, whitening, ids, pose)
        found.append((int(order.min()), table))
    return tuple(table for _, table in sorted(found, key=lambda pair: pair[0]))


def whitened(whiten: Callable[[Array], Array], noise: Array, fail: Fail) -> Array:
    """`whiten` of noise matrices (m, r, r); what it refuses is an InputError at the first row at fault."""
    try:
        return whiten(noise)
    except ModelError:
        for row, single in enumerate(noise):
            try:
                whiten(single[None])
            except ModelError as error:
                raise fail(row, str(error).replace(" 0 ", " ", 1)) from None
        raise


def _poses(edges: Iterable[Edges]) -> IntArray:
    """All poses of robots, sorted."""
    keys = np.unique(np.concatenate([part.keys.ravel() for part in edges]))
    return np.asarray(keys[is_pose(keys)])


def _watchers(edges: Iterable[Edges]) -> tuple[IntArray, IntArray]:
    """The landmarks that robots see, sorted, and the lowest robot that sees each."""
    seen = [part.keys for part in edges if part.keys.shape[1] == 2]
    if not seen:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    pairs = np.concatenate(seen)
    pairs = pairs[is_landmark(pairs[:, 1])]
    marks, robots = pairs[:, 1], robot_of(pairs[:, 0])
    order = np.lexsort((robots, marks))
    keys, first = np.unique(marks[order], return_index=True)
    return keys, np.asarray(robots[order][first])


def _robots(part: Edges, watchers: tuple[IntArray, IntArray]) -> IntArray:
    """Whose each measurement is."""
    robots = robot_of(part.keys[:, 0])
    loose = np.flatnonzero(robots == 0)
    marks, lowest = watchers
    if len(loose) == 0:
        return robots
    nobody = int(lowest.min()) if len(lowest) else 1
    at = np.minimum(np.searchsorted(marks, part.keys[loose, 0]), max(len(marks) - 1, 0))
    seen = marks[at] == part.keys[loose, 0] if len(marks) else np.zeros(len(loose), bool)
    robots = robots.copy()
    robots[loose] = np.where(seen, lowest[at] if len(marks) else nobody, nobody)
    return robots


def _sources(part: Edges, poses: IntArray) -> IntArray:
    """What each measurement sees, as a place in SOURCES."""
    if MODELS[part.model].unary:
        return np.zeros(len(part), np.int64)
    first, second = part.keys.T
    near = np.abs(np.searchsorted(poses, second) - np.searchsorted(poses, first)) == 1
    inside = np.where(near & (part.model == "relative_pose"), SOURCES.index("odometry"), SOURCES.index("loops"))
    others = np.where(robot_of(first) != robot_of(second), SOURCES.index("robots"), inside)
    return np.where(is_landmark(second), SOURCES.index("landmarks"), others)


def _numbers(robots: Sequence[IntArray], sources: Sequence[IntArray], orders: Sequence[IntArray]) -> list[IntArray]:
    """The number of each row among those of its robot and source, in the order of the log."""
    robot, source, order = (np.concatenate(parts) for parts in (robots, sources, orders))
    by_group = np.lexsort((order, source, robot))
    fresh = np.append(True, (np.diff(robot[by_group]) != 0) | (np.diff(source[by_group]) != 0))
    starts = np.flatnonzero(fresh)
    numbers = np.empty(len(order), np.int64)
    numbers[by_group] = np.arange(len(order)) - np.repeat(starts, np.diff(np.append(starts, len(order))))
    return np.split(numbers, np.cumsum([len(part) for part in orders])[:-1])


def robots_of(edges: Iterable[Edges], names: Mapping[int, str]) -> dict[int, int]:
    """The robots that measurements name and the dimension each moves in. InputError for one that does both."""
    dims: dict[int, int] = {}
    for part in edges:
        robots = robot_of(part.keys)
        for robot in np.unique(robots[robots > 0]).tolist():
            if dims.setdefault(robot, part.dim) != part.dim:
                row = int(np.flatnonzero((robots == robot).any(1))[0])
                raise part.fail(row, f"robot {names.get(robot, robot)} has poses in the plane and in space")
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


def values_of(parts: Iterable[tuple[Kind, IntArray, Array]]) -> Values | None:
    """Values from kinds, keys (n,) and rows (n, size) of the state vector; None for no rows."""
    by_kind: dict[Kind, list[tuple[IntArray, Array]]] = {}
    for kind, keys, rows in parts:
        if len(keys):
            by_kind.setdefault(kind, []).append((keys, rows))
    if not by_kind:
        return None
    return Values.of(
        {
            kind: (np.concatenate([keys for keys, _ in found]), np.concatenate([rows for _, rows in found]))
            for kind, found in by_kind.items()
        }
    )
