"""Writing g2o graphs: see `g2o`."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.files.lines import state_words, text_of, write_text
from teamslam.io.graphs.charts import chart, information_of_whitening
from teamslam.io.graphs.g2o_tags import EDGES, NOTE, PLAIN_IDS, VERTICES
from teamslam.io.graphs.graph import no_word_for, parts_of
from teamslam.io.graphs.naming import note_of
from teamslam.io.graphs.symbols import LOWER_FIRST, join_symbol
from teamslam.model import SQUARED, Dataset, Dropped, Kind, Table, index_of, pack, point_kind, pose_kind, robot_of


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes one g2o file and returns what it has no place for: truth, losses, missing estimates (put at the origin).

    Law: `read` gives the same measurements, names and estimates. Ids are plain numbers for robot 1 alone, where they
    are free of clashes, else GTSAM's symbols. InputError for models that g2o has no tag for.
    """
    names = _ids(dataset)
    parts = [(table, _tag(table, ends)) for table, ends in parts_of(dataset)]
    sensors = _Sensors([])
    edges = [line for table, tag in parts for line in _edge_lines(table, tag, names, sensors)]
    vertices, missing = _vertices(dataset, names)
    write_text(path, "\n".join([NOTE + json.dumps(note_of(dataset.names)), *sensors.lines(), *vertices, *edges]) + "\n")
    return _losses(dataset, missing)


def _vertices(dataset: Dataset, names: dict[int, int]) -> tuple[list[str], int]:
    """The VERTEX lines, and how many of them have no estimate."""
    tags = {kind: tag for tag, kind in VERTICES.items()}
    known: dict[int, Array] = {}
    for _, keys, data in () if dataset.initial is None else dataset.initial.parts():
        known.update(zip(keys.tolist(), pack(data), strict=True))
    lines = []
    for key, kind in zip(dataset.layout.keys.tolist(), map(Kind, dataset.layout.kinds.tolist()), strict=True):
        lines.append(f"{tags[kind]} {names[key]} {state_words(known.get(key, _origin(kind)), kind)}")
    return lines, sum(key not in known for key in dataset.layout.keys.tolist())


def _losses(dataset: Dataset, missing: int) -> tuple[Dropped, ...]:
    robust = sum(len(t) for t in dataset.tables if t.loss != SQUARED)
    truth = 0 if dataset.truth is None else len(dataset.truth)
    counts = [
        (missing, "variables without an estimate: written at the origin"),
        (robust, "robust losses of measurements: g2o has no place for them"),
        (truth, "true values: g2o has no place for them"),
    ]
    return tuple(Dropped(count, reason) for count, reason in counts if count)


def _ids(dataset: Dataset) -> dict[int, int]:
    """The id of each variable."""
    keys = dataset.layout.keys
    counts = index_of(keys)
    if set(dataset.robots) == {1} and len(np.unique(counts)) == len(counts) and (counts < PLAIN_IDS).all():
        return dict(zip(keys.tolist(), counts.tolist(), strict=True))
    letters = {0: LOWER_FIRST.landmark, **{robot: LOWER_FIRST.letter(robot) for robot in dataset.robots}}
    for robot, letter in letters.items():
        if letter is None:
            raise InputError(
                f"robot {robot} has no letter in g2o's ids; number robots from 1 to {len(LOWER_FIRST.robots)}"
            )
    return {
        key: join_symbol(str(letters[robot]), count)
        for key, robot, count in zip(keys.tolist(), robot_of(keys).tolist(), counts.tolist(), strict=True)
    }


@dataclass(frozen=True)
class _Sensors:
    """The sensors written so far; a sensor's place is its parameter id."""

    poses: list[Pose]

    def id_of(self, table: Table) -> int:
        """The parameter id of a table's sensor."""
        sensor = (table.sensor or Pose.identity(table.dim)).lift(table.dim)
        for k, known in enumerate(self.poses):
            if known.dim == sensor.dim and not np.any(known.minus(sensor)):
                return k
        self.poses.append(sensor)
        return len(self.poses) - 1

    def lines(self) -> list[str]:
        """The PARAMS lines."""
        return [
            f"PARAMS_SE{pose.dim}OFFSET {k} {state_words(pack(pose), pose_kind(pose.dim))}"
            for k, pose in enumerate(self.poses)
        ]


def _tag(table: Table, ends: tuple[Kind, ...]) -> str:
    """The tag that says what a table holds. InputError where there is none."""
    for name, tag in EDGES.items():
        fits = (tag.model, tag.dim, tag.ends) == (table.model, table.dim, ends)
        if fits and (table.sensor is None or (tag.parameter and len(ends) == 2 and table.sensor.dim <= table.dim)):
            return name
    raise no_word_for(table, ends, "g2o", "the plain format, or PyFG or JRL for ranges")


def _edge_lines(table: Table, name: str, names: dict[int, int], sensors: _Sensors) -> list[str]:
    """The lines of one table."""
    tag = EDGES[name]
    information = np.broadcast_to(information_of_whitening(table.whitening), (len(table), tag.rows, tag.rows))
    if tag.model in ("relative_pose", "pose"):
        a = chart(table.values, tag.dim, half_angle=True)
        information = np.swapaxes(a, 1, 2) @ information @ a
    upper = np.triu_indices(tag.rows)
    parameter = [str(sensors.id_of(table))] if tag.parameter else []
    kind = pose_kind(tag.dim) if tag.model in ("relative_pose", "pose") else point_kind(tag.dim)
    out = []
    for keys, value, matrix in zip(table.keys.tolist(), table.values, information, strict=True):
        words = [name, *(str(names[key]) for key in keys), *parameter, state_words(value, kind)]
        out.append(" ".join([*words, *map(text_of, matrix[upper])]))
    return out


def _origin(kind: Kind) -> Array:
    return pack(Pose.identity(kind.dim)) if kind.is_pose else np.zeros(kind.dim)
