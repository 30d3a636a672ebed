"""Logs for the tests of file formats: any mix of models that a format can hold, and what 'the same log' means."""

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from strategies import generators, random_poses, unit_vectors
from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import (
    MODELS,
    Dataset,
    Names,
    Table,
    Values,
    landmark_key,
    pack,
    point_kind,
    pose_key,
    pose_kind,
)


@dataclass(frozen=True)
class Abilities:
    """What a format can hold: models of sightings of landmarks and robots, absolute ones, and other things."""

    landmarks: tuple[str, ...]
    robots: tuple[str, ...]
    world_poses: tuple[str, ...] = ("pose",)
    world_landmarks: tuple[str, ...] = ("position",)
    sensors: bool = False
    truth: bool = False
    initial: bool = False
    ticks: bool = False
    letters: str = ""  # robots' names, where the format makes them up


ABILITIES = {
    "g2o": Abilities(
        ("point", "bearing"), ("relative_pose",), ("pose", "position"), sensors=True, initial=True, ticks=True
    ),
    "pyfg": Abilities(("point", "range"), ("relative_pose", "range"), truth=True, ticks=True, letters="ABC"),
    "jrl": Abilities(
        ("range", "range_bearing"), ("relative_pose", "range", "range_bearing"), truth=True, initial=True, ticks=True
    ),
}


@st.composite
def logs(draw: st.DrawFn, can: Abilities) -> Dataset:
    """A team's log that a format with these abilities can hold."""
    rng, dim = draw(generators), draw(st.sampled_from([2, 3]))
    robots = list(range(1, draw(st.integers(1, 3)) + 1))
    ticks = can.ticks and draw(st.booleans())
    poses = {r: pose_key(r, _rising(rng, 4, 10**15 if ticks else 50)) for r in robots}
    marks = landmark_key(_rising(rng, 3, 60))
    tables: list[Table] = []
    for robot in robots:
        own = poses[robot]
        tables.append(_table(rng, robot, "odometry", "relative_pose", dim, np.stack([own[:-1], own[1:]], -1)))
        if draw(st.booleans()):
            tables.append(_table(rng, robot, "loops", "relative_pose", dim, own[[[0, 2], [1, 3]]]))
        model = draw(st.sampled_from(can.landmarks))
        if not (model == "bearing" and dim == 3):
            pairs = np.stack([np.repeat(own, 3), np.tile(marks, 4)], -1)[rng.random(12) < 0.6]
            sensor = None
            if can.sensors and model == "point" and draw(st.booleans()):
                sensor = random_poses(rng, dim, spread=0.3)
            tables += [_table(rng, robot, "landmarks", model, dim, pairs, sensor)] if len(pairs) else []
        if len(robots) > 1:
            other = poses[robot % len(robots) + 1]
            model = draw(st.sampled_from(can.robots))
            tables.append(_table(rng, robot, "robots", model, dim, np.stack([own[[0, 2]], other[[1, 3]]], -1)))
        if draw(st.booleans()):
            tables.append(_table(rng, robot, "world", draw(st.sampled_from(can.world_poses)), dim, own[:1, None]))
    seen = np.unique(np.concatenate([t.keys[:, 1] for t in tables if t.source == "landmarks"] or [np.zeros(0, int)]))
    if len(seen) and draw(st.booleans()):
        table = _table(rng, 1, "world", draw(st.sampled_from(can.world_landmarks)), dim, seen[:1, None])
        if not any(t.source == "world" for t in tables) and (tables[1:] and _first_watcher(tables, seen[0]) == 1):
            tables.append(table)
    numbers = {robot: letter for robot, letter in zip(robots, can.letters, strict=False)}
    names = Names(numbers or {1: "Ada"}, {} if can.letters else {int(marks[0]): "door"}, 1e-6 if ticks else 1.0)
    values = _values(rng, dim, np.concatenate(list(poses.values())), np.asarray(seen, np.int64))
    # A format that keeps stamps with true poses needs one for each pose.
    truth = values if can.truth and (ticks or draw(st.booleans())) else None
    initial = values if can.initial and draw(st.booleans()) else None
    return Dataset(dict.fromkeys(robots, dim), tuple(tables), names, truth, initial)


def _first_watcher(tables: list[Table], mark: int) -> int:
    return min(t.robot for t in tables if t.source == "landmarks" and (t.keys[:, 1] == mark).any())


def _rising(rng: np.random.Generator, count: int, below: int) -> IntArray:
    return np.sort(rng.choice(min(below, 10**6), count, replace=False)) * max(below // 10**6, 1) + 1


def _table(
    rng: np.random.Generator, robot: int, source: str, model: str, dim: int, keys: IntArray, sensor: Pose | None = None
) -> Table:
    rows = MODELS[model].residual_rows(dim)
    whitening = np.linalg.cholesky(_spd(rng, len(keys), rows)).swapaxes(1, 2)
    ids = np.arange(len(keys))
    return Table(robot, source, model, dim, keys, measured(rng, model, dim, len(keys)), whitening, ids, sensor)


def _spd(rng: np.random.Generator, count: int, rows: int) -> Array:
    root = rng.normal(size=(count, rows, rows)) + 2.0 * np.eye(rows)
    return np.asarray(root @ root.swapaxes(1, 2) + 0.5 * np.eye(rows))


def measured(rng: np.random.Generator, model: str, dim: int, count: int) -> Array:
    """Any measurements of a model."""
    if model in ("relative_pose", "pose"):
        return pack(random_poses(rng, dim, count))
    distance = rng.uniform(0.5, 9.0, (count, 1))
    bearing = rng.uniform(-3.0, 3.0, (count, 1)) if dim == 2 else unit_vectors(rng, 3, (count,))
    if model == "range":
        return distance
    if model == "bearing":
        return bearing
    if model == "corners":
        return np.concatenate([unit_vectors(rng, 3, (count, 4)).reshape(count, 12), rng.normal(size=(count, 12))], -1)
    return np.concatenate([distance, bearing], -1) if model == "range_bearing" else rng.normal(size=(count, dim))


def _values(rng: np.random.Generator, dim: int, poses: IntArray, marks: IntArray) -> Values:
    parts: dict[object, object] = {pose_kind(dim): (poses, random_poses(rng, dim, len(poses)))}
    if len(marks):
        parts[point_kind(dim)] = (marks, rng.normal(size=(len(marks), dim)))
    return Values.of(parts)  # type: ignore[arg-type]


def assert_same_log(found: Dataset, expected: Dataset) -> None:
    """The same robots, names, measurements with their noise, truth and estimates; order and row numbers may differ."""
    assert found.robots == expected.robots
    assert found.names == expected.names
    mine, theirs = _by_group(found), _by_group(expected)
    assert mine.keys() == theirs.keys()
    for group, tables in theirs.items():
        for name, tolerance in (("keys", 0.0), ("values", 1e-12), ("information", 1e-9)):
            a, b = mine[group][name], tables[name]
            assert a.shape == b.shape, (group, name)
            assert np.abs(a - b).max(initial=0.0) <= tolerance * max(1.0, np.abs(b).max(initial=0.0)), (group, name)
    for name in ("truth", "initial"):
        assert_same_values(getattr(found, name), getattr(expected, name))


def assert_same_values(found: Values | None, expected: Values | None) -> None:
    """The same variables, numbers equal but for rounding."""
    assert (found is None) == (expected is None)
    if found is not None and expected is not None:
        assert np.array_equal(found.layout.keys, expected.layout.keys)
        assert np.array_equal(found.layout.kinds, expected.layout.kinds)
        assert np.abs(found.state - expected.state).max(initial=0.0) < 1e-12


def _by_group(dataset: Dataset) -> dict[object, dict[str, Array]]:
    """Rows by robot, source, model, dimension and sensor, in the order of their keys."""
    groups: dict[object, list[Table]] = {}
    for table in dataset.tables:
        sensor = None if table.sensor is None else tuple(np.round(pack(table.sensor), 9).tolist())
        groups.setdefault((table.robot, table.source, table.model, table.dim, sensor), []).append(table)
    out: dict[object, dict[str, Array]] = {}
    for group, tables in groups.items():
        keys, values = np.concatenate([t.keys for t in tables]), np.concatenate([t.values for t in tables])
        rows = tables[0].row.residual_rows(tables[0].dim)
        whitening = np.concatenate([np.broadcast_to(t.whitening, (len(t), rows, rows)) for t in tables])
        order = np.lexsort([*np.round(values, 6).T[::-1], *keys.T[::-1]])
        information = np.swapaxes(whitening, 1, 2) @ whitening
        out[group] = {"keys": keys[order], "values": values[order], "information": information[order]}
    return out


def assert_rows_numbered_once(dataset: Dataset) -> None:
    """No robot's log has two rows of one source with one number."""
    for robot in dataset.robots:
        for source in {t.source for t in dataset.tables if t.robot == robot}:
            ids = np.concatenate([t.ids for t in dataset.tables if (t.robot, t.source) == (robot, source)])
            assert len(np.unique(ids)) == len(ids)
