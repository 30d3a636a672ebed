"""Writing g2o graphs: see `g2o`."""

import json
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.text import rows_of_text, state_columns, write_text
from teamslam.io.graphs.charts import chart
from teamslam.io.graphs.edges import matching
from teamslam.io.graphs.g2o_tags import EDGES, NOTE, PLAIN_IDS, VERTICES
from teamslam.io.graphs.information import information_of_whitening
from teamslam.io.graphs.naming import note_of
from teamslam.io.graphs.rewording import no_word_for, reworded
from teamslam.io.graphs.symbols import LOWER_FIRST
from teamslam.model import (
    SQUARED,
    Dataset,
    Dropped,
    Kind,
    Layout,
    Names,
    Table,
    Values,
    index_of,
    is_landmark,
    pack,
    point_kind,
    pose_kind,
    robot_of,
)

TAGS = {kind: (tag, form) for tag, (kind, form) in reversed(VERTICES.items())}


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes one g2o file and returns what it has no place for: truth, losses, missing estimates (put at the origin).

    Law: `read` gives the same measurements, names and estimates. Ids are plain numbers for robot 1 alone, where they
    are free of clashes, else GTSAM's symbols. Ranges with bearings become points. InputError for what g2o has no tag
    for (see `lacks`).
    """
    problem = lacks(dataset)
    if problem is not None:
        raise InputError(problem)
    parts, _, said = reworded(dataset, lambda table, ends: _tag(table, ends) is not None)
    ids = Ids(dataset.layout)
    sensors: list[Pose] = []
    edges = [line for table, ends in parts for line in _edge_lines(table, str(_tag(table, ends)), ids, sensors)]
    vertices, missing = _vertices(dataset, ids)
    # The note comes last: GTSAM's reader of the plane finds no edge below a comment.
    write_text(path, "\n".join([*_parameters(sensors), *vertices, *edges, note(dataset.names)]) + "\n")
    return tuple(said) + _losses(dataset, missing)


def lacks(dataset: Dataset) -> str | None:
    """What g2o has no word for in a log; None where it can be written."""
    _, without, _ = reworded(dataset, lambda table, ends: _tag(table, ends) is not None)
    return no_word_for(without, "g2o") or LOWER_FIRST.lacks(set(dataset.robots) - {1}, "g2o's ids")


def note(names: Names) -> str:
    """The comment that carries names and the length of a tick."""
    return NOTE + json.dumps(note_of(names))


class Ids:
    """The ids of variables: plain numbers for robot 1 alone where they are free of clashes, else GTSAM's symbols."""

    def __init__(self, layout: Layout) -> None:
        keys = layout.keys
        robots, counts = robot_of(keys), index_of(keys)
        tags = is_landmark(keys[layout.kinds < Kind.POINT2]).any()  # by its number a tag would be a pose of robot 1
        alone = set(np.unique(robots).tolist()) <= {0, 1} and not tags
        self._plain = bool(alone and len(np.unique(counts)) == len(counts) and (counts < PLAIN_IDS).all())

    def of(self, keys: IntArray) -> IntArray:
        """The ids of keys, any shape."""
        if self._plain:
            return index_of(keys)
        return LOWER_FIRST.symbols(keys)


def vertex_lines(values: Values, ids: Ids) -> list[str]:
    """The VERTEX lines of some values."""
    lines = []
    for kind, keys, data in values.parts():
        tag = TAGS[kind][0]
        words = rows_of_text(state_columns(pack(data), kind))
        lines += [f"{tag} {name} {state}" for name, state in zip(ids.of(keys).tolist(), words, strict=True)]
    return lines


def _vertices(dataset: Dataset, ids: Ids) -> tuple[list[str], int]:
    """The VERTEX lines of all variables, and how many of them have no estimate and lie at the origin."""
    layout = dataset.layout
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {
        kind: (layout.keys_of(kind), _origin(kind, len(layout.keys_of(kind)))) for kind in Kind
    }
    values = Values.of({kind: part for kind, part in parts.items() if len(part[0])})
    known = matching(dataset.initial, dataset)[0]
    values = values if known is None else values.update(known)
    return vertex_lines(values, ids), len(layout) - (0 if known is None else len(known))


def _losses(dataset: Dataset, missing: int) -> tuple[Dropped, ...]:
    robust = sum(len(t) for t in dataset.tables if t.loss != SQUARED)
    truth = 0 if dataset.truth is None else len(dataset.truth)
    counts = [
        (missing, "variables without an estimate: written at the origin"),
        (robust, "robust losses of measurements: g2o has no place for them"),
        (truth, "true values: g2o has no place for them"),
    ]
    return tuple(Dropped(count, reason) for count, reason in counts if count)


def _tag(table: Table, ends: tuple[Kind, ...]) -> str | None:
    """The tag that says what a table holds; None where there is none."""
    for name, tag in EDGES.items():
        fits = (tag.model, tag.dim, tag.ends) == (table.model, table.dim, ends)
        if fits and (table.sensor is None or (tag.parameter and len(ends) == 2 and table.sensor.dim <= table.dim)):
            return name
    return None


def _edge_lines(table: Table, name: str, ids: Ids, sensors: list[Pose]) -> list[str]:
    """The lines of one table."""
    tag = EDGES[name]
    whitening = np.broadcast_to(table.whitening, (len(table), tag.rows, tag.rows))
    if tag.model in ("relative_pose", "pose"):
        whitening = whitening @ chart(table.values, tag.dim, half_angle=True)
    information = information_of_whitening(whitening)
    above = np.triu_indices(tag.rows)
    parameter = f" {_place_of(table, sensors)}" if tag.parameter else ""
    kind = pose_kind(tag.dim) if tag.model in ("relative_pose", "pose") else point_kind(tag.dim)
    values = table.values if tag.model == "bearing" else state_columns(table.values, kind)
    numbers = rows_of_text(np.concatenate([values, information[:, above[0], above[1]]], -1))
    names = [" ".join(map(str, row)) for row in ids.of(table.keys).tolist()]
    return [f"{name} {ends}{parameter} {row}" for ends, row in zip(names, numbers, strict=True)]


def _place_of(table: Table, sensors: list[Pose]) -> int:
    """The parameter id of a table's sensor, which is put among `sensors` where it is new."""
    sensor = (table.sensor or Pose.identity(table.dim)).lift(table.dim)
    for k, known in enumerate(sensors):
        if known.dim == sensor.dim and not np.any(known.minus(sensor)):
            return k
    sensors.append(sensor)
    return len(sensors) - 1


def _parameters(sensors: list[Pose]) -> list[str]:
    """The PARAMS lines."""
    rows = [rows_of_text(state_columns(pack(pose)[None], pose_kind(pose.dim)))[0] for pose in sensors]
    return [f"PARAMS_SE{pose.dim}OFFSET {k} {row}" for k, (pose, row) in enumerate(zip(sensors, rows, strict=True))]


def _origin(kind: Kind, count: int) -> Pose | Array:
    return Pose.identity(kind.dim, (count,)) if kind.is_pose else np.zeros((count, kind.dim))
