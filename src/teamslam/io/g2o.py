"""g2o graphs (.g2o): vertices with estimates and edges with information matrices, for one robot or a team.

What is read: VERTEX_SE2, VERTEX_SE3:QUAT, VERTEX_XY, VERTEX_TRACKXYZ; the edges of `EDGES`; PARAMS_SE2OFFSET and
PARAMS_SE3OFFSET, which become `Table.sensor`. Vertices are estimates and become `Dataset.initial`. FIX lines, tags that
teamslam does not know and vertices without an edge are left out and counted. A folder holds one file for each robot; an
edge that stands in the files of both its robots is one measurement, and its first vertex is the observer.

Ids are GTSAM's symbols (the robot's letter in the top byte: a, b, c are robots 1, 2, 3; vertices of landmark tags may
have any letter) or plain numbers: those of a single file are robot 1's, in a folder the k-th file is robot k's.

Noise: g2o's error of a relative pose is [zR'(hT - zT) ; vec of the quaternion of zR' hR], whose rotation part is half
the angle. It is converted to teamslam's mixed chart to first order at the measurement (`charts`; exact in the plane and
for translations), and back on writing. Files that GTSAM wrote state information in GTSAM's chart, which has the full
angle: `chart = "gtsam"` reads them so.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.charts import chart, information_of_whitening, inverse_chart, whitening_of_information
from teamslam.io.graph import Edge, Whitener, matching, tables_of, values_of
from teamslam.io.lines import Line, read_lines, text_of, triangle, write_text
from teamslam.io.options import options_of
from teamslam.io.symbols import LOWER_FIRST, fits, split_symbol, symbol
from teamslam.model import (
    SQUARED,
    Dataset,
    Dropped,
    Kind,
    Names,
    Table,
    Values,
    index_of,
    landmark_key,
    pack,
    pose_key,
    robot_of,
)

NOTE = "# teamslam "  # a comment to other programs: names and the length of a tick, as JSON
PLAIN_IDS = 1 << 31  # g2o's own ids are 32-bit


@dataclass(frozen=True)
class Tag:
    """One row of EDGES: the model, its dimension, the kinds of vertices, and whether a parameter id stands before z."""

    model: str
    dim: int
    ends: tuple[Kind, ...]
    parameter: bool = False

    @property
    def numbers(self) -> int:
        """Numbers in the measurement as the file writes it."""
        return {"relative_pose": 0, "pose": 0, "bearing": 1}.get(self.model, self.dim) or (3 if self.dim == 2 else 7)

    @property
    def rows(self) -> int:
        """Rows of the information matrix."""
        return {"relative_pose": 0, "pose": 0, "bearing": 1}.get(self.model, self.dim) or (3 if self.dim == 2 else 6)


VERTICES: dict[str, Kind] = {
    "VERTEX_SE2": Kind.POSE2,
    "VERTEX_SE3:QUAT": Kind.POSE3,
    "VERTEX_XY": Kind.POINT2,
    "VERTEX_TRACKXYZ": Kind.POINT3,
}

EDGES: dict[str, Tag] = {
    "EDGE_SE2": Tag("relative_pose", 2, (Kind.POSE2, Kind.POSE2)),
    "EDGE_SE3:QUAT": Tag("relative_pose", 3, (Kind.POSE3, Kind.POSE3)),
    "EDGE_SE2_XY": Tag("point", 2, (Kind.POSE2, Kind.POINT2)),
    "EDGE_SE2_POINTXY_OFFSET": Tag("point", 2, (Kind.POSE2, Kind.POINT2), parameter=True),
    "EDGE_SE3_TRACKXYZ": Tag("point", 3, (Kind.POSE3, Kind.POINT3), parameter=True),
    "EDGE_BEARING_SE2_XY": Tag("bearing", 2, (Kind.POSE2, Kind.POINT2)),
    "EDGE_PRIOR_SE2": Tag("pose", 2, (Kind.POSE2,)),
    "EDGE_SE2_PRIOR": Tag("pose", 2, (Kind.POSE2,)),
    "EDGE_SE3_PRIOR": Tag("pose", 3, (Kind.POSE3,), parameter=True),
    "EDGE_PRIOR_SE2_XY": Tag("position", 2, (Kind.POSE2,)),
    "EDGE_SE3_XYZ_PRIOR": Tag("position", 3, (Kind.POSE3,), parameter=True),
    "EDGE_PRIOR_XY": Tag("position", 2, (Kind.POINT2,)),
    "EDGE_XYZ_PRIOR": Tag("position", 3, (Kind.POINT3,)),
}

PARAMETERS = {"PARAMS_SE2OFFSET": 2, "PARAMS_SE3OFFSET": 3}


@dataclass(frozen=True)
class Options:
    """What the reader may be told: whose chart the information of relative poses is in, 'g2o' or 'gtsam'."""

    chart: str = "g2o"


# --- reading ----------------------------------------------------------------------------------------------------------


def sniff(path: Path) -> bool:
    """A .g2o file, or a folder of them."""
    return any(path.glob("*.g2o")) if path.is_dir() else path.suffix == ".g2o"


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The measurements of a g2o file, or of a folder with one file for each robot; `options` as in `Options`.

    InputError names file, line and field of what cannot be read: an edge whose vertex is nowhere or of the wrong kind,
    a vertex given twice, information that is not positive definite, numbers that are none.
    """
    chosen = options_of(Options, options, reader="g2o")
    if chosen.chart not in ("g2o", "gtsam"):
        raise InputError(f"expected 'g2o' or 'gtsam', found '{chosen.chart}'", field="chart")
    files = sorted(path.glob("*.g2o")) if path.is_dir() else [path]
    if not files:
        raise InputError("expected files *.g2o in this folder, found none", path=path)
    graph = _Graph()
    for number, file in enumerate(files, 1):
        graph.add_file(file, number)
    return graph.dataset(str(path), half_angle=chosen.chart == "g2o")


@dataclass
class _Graph:
    """The content of the files read so far."""

    vertices: dict[int, tuple[Kind, Sequence[float]]] = field(default_factory=dict)  # by key
    plain: dict[int, dict[int, int]] = field(default_factory=dict)  # by file: plain id -> key
    edges: list[tuple[int, Line]] = field(default_factory=list)  # with the number of the file
    sensors: dict[tuple[int, int], Pose] = field(default_factory=dict)  # by dimension and id
    robots: dict[int, str] = field(default_factory=dict)
    unknown: dict[str, int] = field(default_factory=dict)
    fixed: int = 0
    repeated: int = 0
    names: Names | None = None

    def add_file(self, path: Path, number: int) -> None:
        """All lines of one file."""
        own: set[int] = set()
        self.plain[number] = {}
        self.names = self.names or _noted(path)
        for line in read_lines(path):
            if line.tag in VERTICES:
                self._add_vertex(line, number, own)
            elif line.tag in EDGES:
                self.edges.append((number, line))
            elif line.tag in PARAMETERS:
                self._add_parameter(line)
            elif line.tag == "FIX":
                self.fixed += len(line.words)
            else:
                self.unknown[line.tag] = self.unknown.get(line.tag, 0) + 1
        if len(self.plain[number]):
            self.robots.setdefault(number, path.stem)

    def _add_vertex(self, line: Line, file: int, own: set[int]) -> None:
        kind = VERTICES[line.tag]
        names = {Kind.POSE2: "x y theta", Kind.POSE3: "x y z qx qy qz qw", Kind.POINT2: "x y", Kind.POINT3: "x y z"}
        fields = names[kind].split()
        line.check_length(1 + len(fields), form=f"{line.tag} id {names[kind]}")
        key = self._new_key(line, kind, file)
        if key in own:
            raise line.error(f"vertex {line.words[0]} stands twice in this file; give every vertex one line")
        own.add(key)
        state = _state(line, 1, kind)
        if key in self.vertices:
            self.repeated += 1
        else:
            self.vertices[key] = (kind, state)

    def _new_key(self, line: Line, kind: Kind, file: int) -> int:
        name = line.integer(0, "id")
        letter, count = split_symbol(name) if name >= 0 else ("", name)
        if not fits(count) or (not letter and name >= 1 << 51):
            raise line.error(f"ids run from 0 to 2^51 - 1 (behind a letter in the top byte), found {name}", "id")
        if not kind.is_pose:
            key = int(landmark_key(count))
            known = self.vertices.get(key)
            if known and not letter and self.plain[file].get(name) is None and len(self.plain) == 1:
                raise line.error(f"vertex {name} stands twice in this file; give every vertex one line")
        elif letter:
            robot = LOWER_FIRST.robot(letter)
            if robot is None:
                raise line.error(f"the letter '{letter}' of a pose's id is no robot's (letters but L)", "id")
            self.robots[robot] = letter
            key = int(pose_key(robot, count))
        else:
            key = int(pose_key(file, count))
        if not letter:
            if name in self.plain[file]:
                raise line.error(f"vertex {name} stands twice in this file; give every vertex one line")
            self.plain[file][name] = key
        return key

    def _add_parameter(self, line: Line) -> None:
        dim = PARAMETERS[line.tag]
        line.check_length(
            4 if dim == 2 else 8, form=f"{line.tag} id " + ("x y theta" if dim == 2 else "x y z qx qy qz qw")
        )
        self.sensors.setdefault((dim, line.integer(0, "id")), _pose(line, 1, dim))

    # --- edges --------------------------------------------------------------------------------------------------------

    def dataset(self, origin: str, half_angle: bool) -> Dataset:
        """Everything as one Dataset."""
        if not self.edges:
            raise InputError(f"no line is an edge that teamslam knows ({', '.join(EDGES)})", path=origin)
        edges, twice = self._edges()
        dims = self._dims(edges)
        names = self.names or Names({robot: self.robots[robot] for robot in dims if robot in self.robots}, {}, 1.0)
        numbers = {(dim, name): k for k, (dim, name) in enumerate(self.sensors)}
        placed = [e if e.sensor is None else _with_sensor(e, numbers) for e in edges]
        sensors = {k: self.sensors[name] for name, k in numbers.items()}
        dataset = Dataset(dims, tables_of(placed, _whitener(half_angle), sensors), names, origin=origin)
        initial, alone = matching(self._estimate(), dataset)
        return Dataset(dims, dataset.tables, names, initial=initial, dropped=self._dropped(twice, alone), origin=origin)

    def _estimate(self) -> Values | None:
        """The vertices; None where all lie at the origin, which is no estimate."""
        values = values_of(self.vertices)
        if values is None or all(not np.any(_chart_at_origin(kind, row)) for kind, row in self.vertices.values()):
            return None
        return values

    def _edges(self) -> tuple[list[Edge], int]:
        """The edges, each once, and how many stood in two files."""
        first_in: dict[tuple[object, ...], int] = {}
        edges, twice = [], 0
        for file, line in self.edges:
            edge = self._edge(line, file)
            content = (line.tag, edge.keys, edge.sensor, edge.value, edge.noise.tobytes())
            if first_in.setdefault(content, file) != file:
                twice += 1
            else:
                edges.append(edge)
        return edges, twice

    def _edge(self, line: Line, file: int) -> Edge:
        tag = EDGES[line.tag]
        start = len(tag.ends) + tag.parameter
        line.check_length(
            start + tag.numbers + triangle(tag.rows),
            form=f"{line.tag} {'id id' if len(tag.ends) == 2 else 'id'} {'parameter ' if tag.parameter else ''}"
            f"measurement ({tag.numbers} numbers), upper triangle of the information ({triangle(tag.rows)} numbers)",
        )
        keys = tuple(self._end(line, at, kind, file) for at, kind in enumerate(tag.ends))
        if len(keys) == 2 and keys[0] == keys[1]:
            raise line.error(f"the edge goes from vertex {line.words[0]} to itself")
        if tag.model in ("relative_pose", "pose"):
            value = tuple(pack(_pose(line, start, tag.dim)).tolist())
        else:
            value = tuple(line.floats(start, "xyz"[: tag.numbers] if tag.model != "bearing" else ["bearing"]))
        noise = line.symmetric(start + tag.numbers, tag.rows, "I")
        return Edge(tag.model, tag.dim, keys, value, noise, line, self._sensor(line, tag))

    def _end(self, line: Line, at: int, kind: Kind, file: int) -> int:
        """The key of an edge's vertex, which must be known and of the right kind."""
        name = line.integer(at, "id")
        letter, count = split_symbol(name) if name >= 0 else ("", name)
        key: int | None = None
        if letter and fits(count):
            robot = LOWER_FIRST.robot(letter) if kind.is_pose else None
            key = int(pose_key(robot, count)) if robot else int(landmark_key(count))
            if robot and robot not in self.robots:  # a robot whose file was not given: no estimate, but a name
                return key
        elif not letter:
            places = [self.plain[file], *(ids for other, ids in self.plain.items() if other != file)]
            key = next((ids[name] for ids in places if name in ids), None)
        if key is None or key not in self.vertices:
            raise line.error(f"vertex {name} is not defined by any VERTEX line", "id")
        if self.vertices[key][0] is not kind:
            raise line.error(f"vertex {name} is a {self.vertices[key][0].name}, expected a {kind.name}", "id")
        return key

    def _sensor(self, line: Line, tag: Tag) -> int | None:
        """The sensor id of an edge; None for a sensor that is the body."""
        if not tag.parameter:
            return None
        name = line.integer(len(tag.ends), "parameter")
        if (tag.dim, name) not in self.sensors:
            raise line.error(f"parameter {name} is not defined by any PARAMS_SE{tag.dim}OFFSET line", "parameter")
        sensor = self.sensors[tag.dim, name]
        if not np.any(sensor.minus(Pose.identity(tag.dim))):
            return None
        if len(tag.ends) == 1:
            raise line.error("an absolute measurement by a sensor that is not at the body's origin is not supported")
        return name

    def _dims(self, edges: Iterable[Edge]) -> dict[int, int]:
        """The robots and the dimension each moves in."""
        dims: dict[int, int] = {}
        for edge in edges:
            tag = EDGES[edge.place.tag]
            for key, kind in zip(edge.keys, tag.ends, strict=True):
                if kind.is_pose and dims.setdefault(int(robot_of(key)), kind.dim) != kind.dim:
                    name = self.robots.get(int(robot_of(key)), str(robot_of(key)))
                    raise edge.place.error(f"robot {name} has poses in the plane and in space")
        return dict(sorted(dims.items()))

    def _dropped(self, twice: int, alone: int) -> tuple[Dropped, ...]:
        counts = [
            (twice, "edges that stand in the files of both their robots: one measurement each"),
            (self.repeated, "vertices that stand in several files: the first counts"),
            (alone, "vertices without an edge"),
            (self.fixed, "FIX lines: teamslam chooses the frame itself, all vertices are free"),
            *((n, f"lines with the unknown tag {tag[:60]}") for tag, n in self.unknown.items()),
        ]
        return tuple(Dropped(count, reason) for count, reason in counts if count)


def _with_sensor(edge: Edge, numbers: Mapping[tuple[int, int], int]) -> Edge:
    assert edge.sensor is not None
    return Edge(edge.model, edge.dim, edge.keys, edge.value, edge.noise, edge.place, numbers[edge.dim, edge.sensor])


def _chart_at_origin(kind: Kind, row: Sequence[float]) -> Array:
    state = np.array(row)
    if not kind.is_pose:
        return state
    d = kind.dim
    return np.concatenate([state[:d], (state[d:].reshape(d, d) - np.eye(d)).ravel()])


def _state(line: Line, start: int, kind: Kind) -> tuple[float, ...]:
    """A vertex's row of the state vector."""
    if kind.is_pose:
        return tuple(pack(_pose(line, start, kind.dim)).tolist())
    return tuple(line.floats(start, "xyz"[: kind.dim]))


def _pose(line: Line, start: int, dim: int) -> Pose:
    """A pose: x y theta, or x y z qx qy qz qw."""
    if dim == 2:
        return Pose.from_xytheta(np.array(line.floats(start, ("x", "y", "theta"))))
    numbers = np.array(line.floats(start, ("x", "y", "z", "qx", "qy", "qz", "qw")))
    length = float(np.linalg.norm(numbers[3:]))
    if not 0.9 < length < 1.1:
        raise line.error(f"a quaternion has length 1, found {length:.3g} (qx qy qz qw)")
    return Pose.from_quaternion(numbers[:3], numbers[[6, 3, 4, 5]])


def _whitener(half_angle: bool) -> Whitener:
    def whiten(model: str, dim: int, values: Array, information: Array) -> Array:
        if model in ("relative_pose", "pose"):
            inverse = inverse_chart(values, dim, half_angle)
            information = np.swapaxes(inverse, 1, 2) @ information @ inverse
        return whitening_of_information(information)

    return whiten


def _noted(path: Path) -> Names | None:
    """The names that a file of teamslam's own making carries in a comment."""
    with path.open(encoding="utf-8") as file:
        first = file.readline()
    if not first.startswith(NOTE):
        return None
    try:
        note = json.loads(first[len(NOTE) :])
        return Names(
            {int(k): str(v) for k, v in note["robots"].items()},
            {int(k): str(v) for k, v in note["landmarks"].items()},
            float(note["tick_s"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError("teamslam's note of names is damaged; remove the line", path=path, line=1) from None


# --- writing ----------------------------------------------------------------------------------------------------------


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes one g2o file and returns what it has no place for: truth, losses, missing estimates (put at the origin).

    Law: `read` gives the same measurements, names and estimates. Ids are plain numbers for robot 1 alone, where they
    are free of clashes, else GTSAM's symbols. InputError for models that g2o has no tag for.
    """
    names = _ids(dataset)
    layout, initial = dataset.layout, dataset.initial
    note = {
        "tick_s": dataset.names.tick_s,
        "robots": {str(k): v for k, v in dataset.names.robots.items()},
        "landmarks": {str(k): v for k, v in dataset.names.landmarks.items()},
    }
    lines = [NOTE + json.dumps(note)]
    sensors = _parameters(dataset, lines)
    tags = {kind: tag for tag, kind in VERTICES.items()}
    missing = 0
    for key, kind in zip(layout.keys.tolist(), map(Kind, layout.kinds.tolist()), strict=True):
        known = initial is not None and bool(initial.layout.contains(key))
        missing += not known
        row = initial.only(np.array([key])).state if known and initial is not None else _origin(kind)
        lines.append(f"{tags[kind]} {names[key]} {_written(row, kind)}")
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
        key: symbol(str(letters[robot]), count)
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
            lines.append(f"PARAMS_SE{sensor.dim}OFFSET {len(written)} {_written(pack(sensor), kind)}")
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
        words += [_written(value, kind), *(text_of(number) for number in matrix[upper])]
        out.append(" ".join(words))
    return out


def _written(row: Array, kind: Kind) -> str:
    """A row of the state vector in g2o's words."""
    if not kind.is_pose:
        return " ".join(text_of(number) for number in row)
    d = kind.dim
    pose = Pose(row[d:].reshape(d, d), row[:d])
    if d == 2:
        return " ".join(text_of(number) for number in pose.xytheta())
    w, x, y, z = pose.quaternion_wxyz()
    return " ".join(text_of(number) for number in (*row[:3], x, y, z, w))


def _origin(kind: Kind) -> Array:
    return pack(Pose.identity(kind.dim)) if kind.is_pose else np.zeros(kind.dim)
