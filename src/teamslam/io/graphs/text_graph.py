"""Graphs in text, one record a line: g2o's, TORO's and iSAM's words, which people mix. One file becomes one `Part`."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.delimited import read_text
from teamslam.io.files.records import Records, read_records, triangle
from teamslam.io.graphs import g2o_tags, toro_tags
from teamslam.io.graphs.charts import inverse_chart
from teamslam.io.graphs.edges import whitened
from teamslam.io.graphs.information import transported
from teamslam.io.graphs.naming import names_in
from teamslam.io.graphs.part import Measured, Part, Vertices
from teamslam.io.graphs.tags import FORMS, Tag
from teamslam.io.graphs.toro_noise import Dialect, dialect_of, whitening_of
from teamslam.model import Dropped, Kind, Names, whitening_of_information

VERTICES = g2o_tags.VERTICES | toro_tags.VERTICES


def read_part(path: Path, *, half_angle: bool = True, noise: str | None = None) -> Part:
    """What a file holds. `half_angle`: whether rotations' information is of half the angle, as g2o means it; `noise`:
    what TORO's and iSAM's numbers are, where that is known.

    InputError names file, line and field of what cannot be read.
    """
    lines = [_named(records) for records in read_records(path)]
    sensors = _Sensors(path, [records for records in lines if records.tag in g2o_tags.PARAMETERS])
    dialect = dialect_of(lines, noise)
    measured: list[Measured] = []
    empty = 0
    for records in lines:
        if records.tag in g2o_tags.EDGES:
            found = [_g2o_edges(part, sensors, half_angle) for part in records.by_length()]
            empty += len(records) - sum(map(len, found))
            measured += found
        elif records.tag in toro_tags.EDGES:
            measured += [_toro_edges(part, dialect) for part in records.by_length()]
    unit = sum(len(part) for part in measured if _without_noise(part))
    notes = [dialect.note, f"{unit} measurements state no noise: 1 m and 1 rad are taken" if unit else None]
    return Part(
        path,
        vertices=[_vertices(records, VERTICES) for records in lines if records.tag in VERTICES],
        measured=measured,
        sensors=sensors.poses,
        fixed=[records for records in lines if records.tag == "FIX"],
        truth=[_vertices(records, toro_tags.TRUTH) for records in lines if records.tag in toro_tags.TRUTH],
        dropped=[
            *([Dropped(empty, "edges whose information is zero: they say nothing")] if empty else []),
            *_dropped(lines),
        ],
        notes=[note for note in notes if note],
        names=_noted(path),
    )


def is_known(tag: str | None, words: Iterable[str]) -> bool:
    """Whether a file's first word is one of a format's."""
    return tag is not None and tag.removeprefix(g2o_tags.TUTORIAL) in words


def _named(records: Records) -> Records:
    """The records under the tag that the tables know."""
    return Records(records.path, records.tag.removeprefix(g2o_tags.TUTORIAL), records.lines, records.words)


def _vertices(records: Records, tags: dict[str, tuple[Kind, str]]) -> Vertices:
    kind, form = tags[records.tag]
    names = FORMS[form].names
    records.check_length(1 + len(names), form=f"{records.tag} id {' '.join(names)}")
    return Vertices(kind, records.integers(0, "id"), FORMS[form].rows(records, 1), records)


# --- g2o --------------------------------------------------------------------------------------------------------------


def _g2o_edges(records: Records, sensors: "_Sensors", half_angle: bool) -> Measured:
    """Edges of one tag and length that say something; a sensor's id may be left out where the sensor is the body."""
    tag = g2o_tags.EDGES[records.tag]
    ends, size = len(tag.ends), tag.numbers + triangle(tag.rows)
    records.check_length(*({ends + size, ends + size + tag.parameter}), form=tag.line(records.tag))
    with_sensor = bool(len(records)) and len(records.words[0]) > ends + size
    start = ends + with_sensor
    information = records.symmetric(start + tag.numbers, tag.rows, "the information")
    says = np.asarray(information.any((1, 2)))
    if not says.all():
        records, information = records.select(says), information[says]
    values = FORMS[tag.form].rows(records, start)
    whitening = whitened(whitening_of_information, information, records.error)
    if tag.model in ("relative_pose", "pose"):
        whitening = transported(whitening, inverse_chart(values, tag.dim, half_angle))
    sensor = sensors.of(records, tag) if with_sensor else np.full(len(records), -1)
    return _measured(records, tag, values, whitening, sensor)


def _measured(records: Records, tag: Tag, values: Array, whitening: Array, sensor: IntArray) -> Measured:
    ids = np.stack([records.integers(k, "id") for k in range(len(tag.ends))], -1)
    return Measured(tag.model, tag.dim, tag.ends, ids, values, whitening, sensor, records)


class _Sensors:
    """The sensors that a file's PARAMS lines define."""

    def __init__(self, path: Path, records: Sequence[Records]) -> None:
        self.path = path
        self.poses: list[Pose] = []
        self._places: dict[tuple[int, int], int] = {}
        for lines in records:
            dim = g2o_tags.PARAMETERS[lines.tag]
            names = FORMS["xytheta" if dim == 2 else "quaternion"].names
            lines.check_length(1 + len(names), form=f"{lines.tag} id {' '.join(names)}")
            found = lines.poses(1, dim)
            for row, name in enumerate(lines.integers(0, "id").tolist()):
                self._add(lines, row, (dim, name), found[np.array([row])][0])

    def _add(self, lines: Records, row: int, name: tuple[int, int], sensor: Pose) -> None:
        same = (k for k, s in enumerate(self.poses) if s.dim == sensor.dim and not np.any(s.minus(sensor)))
        place = next(same, len(self.poses))
        self.poses += [sensor] if place == len(self.poses) else []
        if self._places.setdefault(name, place) != place:
            raise lines.error(row, f"parameter {name[1]} is defined twice in this file, and differently", "id")

    def of(self, records: Records, tag: Tag) -> IntArray:
        """The places of edges' sensors; -1 for a sensor that is the body."""
        names = records.integers(len(tag.ends), "parameter")
        out = np.empty(len(records), np.int64)
        for name in np.unique(names).tolist():
            rows = names == name
            if (tag.dim, name) not in self._places:
                body = "0 0 0" if tag.dim == 2 else "0 0 0 0 0 0 1"
                problem = f"parameter {name} is not defined by any PARAMS_SE{tag.dim}OFFSET line; of a sensor at the " \
                    f"body's origin it is 'PARAMS_SE{tag.dim}OFFSET {name} {body}'"  # fmt: skip
                raise records.error(int(np.flatnonzero(rows)[0]), problem, "parameter")
            place = self._places[tag.dim, name]
            at_body = not np.any(self.poses[place].minus(Pose.identity(tag.dim)))
            if not at_body and tag.model == "pose":
                raise records.error(
                    int(np.flatnonzero(rows)[0]),
                    "an absolute pose of a sensor that is not at the body's origin is not supported",
                )
            # g2o leaves the sensor of a measured position out of account, so it is left out here.
            out[rows] = -1 if at_body or tag.model == "position" else place
        return out


# --- TORO and iSAM ----------------------------------------------------------------------------------------------------


def _toro_edges(records: Records, dialect: Dialect) -> Measured:
    """Edges of one tag and length; where the noise is left out it is one unit in every direction."""
    tag = toro_tags.EDGES[records.tag]
    start = len(tag.ends) + tag.numbers
    count = tag.numbers if records.tag in toro_tags.SIGMAS else triangle(tag.rows)
    lengths = (start + count,) if records.tag in toro_tags.SIGMAS else (start, start + count)
    records.check_length(*lengths, form=tag.line(records.tag, noise=f"noise ({count} numbers)"))
    values = FORMS[tag.form].rows(records, len(tag.ends))
    whitening = whitening_of(records, tag, start, values, dialect)
    return _measured(records, tag, values, whitening, np.full(len(records), -1))


def _without_noise(part: Measured) -> bool:
    tag = toro_tags.EDGES.get(part.records.tag)
    return tag is not None and len(part) > 0 and len(part.records.words[0]) == len(tag.ends) + tag.numbers


# --- the rest ---------------------------------------------------------------------------------------------------------


def _dropped(lines: Sequence[Records]) -> Iterable[Dropped]:
    """Lines that are of no use here, by their tag."""
    known = {*VERTICES, *g2o_tags.EDGES, *toro_tags.EDGES, *toro_tags.TRUTH, *g2o_tags.PARAMETERS, "FIX"}
    for records in lines:
        if records.tag in toro_tags.REPEATS:
            yield Dropped(len(records), toro_tags.REPEATS[records.tag])
        elif records.tag not in known:
            yield Dropped(len(records), f"lines with the unknown tag {records.tag[:60]}")


def _noted(path: Path) -> Names | None:
    """The names that a file of teamslam's own making carries in a comment."""
    text = read_text(path)
    start = 0 if text.startswith(g2o_tags.NOTE) else text.rfind(f"\n{g2o_tags.NOTE}") + 1
    if not text.startswith(g2o_tags.NOTE, start):
        return None
    line, number = text[start:].partition("\n")[0], text.count("\n", 0, start) + 1
    try:
        return names_in(json.loads(line[len(g2o_tags.NOTE) :]))
    except (ValueError, RecursionError):
        raise InputError("teamslam's note of names is damaged; remove the line", path=path, line=number) from None
