"""Writing g2o graphs: see `g2o`."""

import json
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.charts import chart, information_of_whitening
from teamslam.io.g2o_tags import EDGES, NOTE, PLAIN_IDS, VERTICES
from teamslam.io.lines import state_words, text_of, write_text
from teamslam.io.naming import note_of
from teamslam.io.symbols import LOWER_FIRST, join_symbol
from teamslam.model import SQUARED, Dataset, Dropped, Kind, Table, index_of, pack, robot_of


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes one g2o file and returns what it has no place for: truth, losses, missing estimates (put at the origin).

    Law: `read` gives the same measurements, names and estimates. Ids are plain numbers for robot 1 alone, where they
    are free of clashes, else GTSAM's symbols. InputError for models that g2o has no tag for.
    """
    names = _ids(dataset)
    layout, initial = dataset.layout, dataset.initial
    lines = [NOTE + json.dumps(note_of(dataset.names))]
    sensors = _parameters(dataset, lines)
    tags = {kind: tag for tag, kind in VERTICES.items()}
    missing = 0
    for key, kind in zip(layout.keys.tolist(), map(Kind, layout.kinds.tolist()), strict=True):
        known = initial is not None and bool(initial.layout.contains(key))
        missing += not known
        row = initial.only(np.array([key])).state if known and initial is not None else _origin(kind)
        lines.append(f"{tags[kind]} {names[key]} {state_words(row, kind)}")
    for table in dataset.tables:
        lines += _edge_lines(table, dataset, names, sensors)
    write_text(path, "\n".join(lines) + "\n")
    return _losses(dataset, missing)


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


def _parameters(dataset: Dataset, lines: list[str]) -> dict[int, int]:
    """Writes the sensors and returns the parameter id of each table (by its place); 0 is the body itself."""
    ids: dict[int, int] = {}
    written: list[Pose] = []
    for place, table in enumerate(dataset.tables):
        if table.model not in ("point", "pose", "position") or (table.dim == 2 and table.sensor is None):
            continue
        sensor = table.sensor or Pose.identity(table.dim)
        same = [k for k, s in enumerate(written) if s.dim == sensor.dim and not np.any(s.minus(sensor))]
        if not same:
            kind = Kind.POSE2 if sensor.dim == 2 else Kind.POSE3
            lines.append(f"PARAMS_SE{sensor.dim}OFFSET {len(written)} {state_words(pack(sensor), kind)}")
            written.append(sensor)
        ids[place] = same[0] if same else len(written) - 1
    return ids


def _edge_lines(table: Table, dataset: Dataset, names: dict[int, int], sensors: dict[int, int]) -> list[str]:
    """The lines of one table."""
    place = next(k for k, t in enumerate(dataset.tables) if t is table)
    kinds = [Kind(kind) for kind in dataset.layout.kinds[dataset.layout.index(table.keys[:1].ravel())].tolist()]
    tag_name = next(
        (
            name
            for name, tag in EDGES.items()
            if (tag.model, tag.dim, tag.ends) == (table.model, table.dim, tuple(kinds))
            and (tag.parameter or table.sensor is None)
        ),
        None,
    )
    if len(table) == 0:
        return []
    if tag_name is None:
        raise InputError(
            f"g2o has no tag for {table.source} ({table.model}, {table.dim}D, {' to '.join(k.name for k in kinds)}); "
            f"write the plain format, or PyFG or JRL for ranges"
        )
    tag = EDGES[tag_name]
    information = np.broadcast_to(information_of_whitening(table.whitening), (len(table), tag.rows, tag.rows))
    if tag.model in ("relative_pose", "pose"):
        a = chart(table.values, tag.dim, half_angle=True)
        information = np.swapaxes(a, 1, 2) @ information @ a
    upper = np.triu_indices(tag.rows)
    kind = {"relative_pose": Kind(tag.dim - 2), "pose": Kind(tag.dim - 2)}.get(tag.model, Kind(tag.dim))
    out = []
    for keys, value, matrix in zip(table.keys.tolist(), table.values, information, strict=True):
        words = [tag_name, *(str(names[key]) for key in keys)]
        words += [str(sensors[place])] if tag.parameter else []
        words += [state_words(value, kind), *(text_of(number) for number in matrix[upper])]
        out.append(" ".join(words))
    return out


def _origin(kind: Kind) -> Array:
    return pack(Pose.identity(kind.dim)) if kind.is_pose else np.zeros(kind.dim)
