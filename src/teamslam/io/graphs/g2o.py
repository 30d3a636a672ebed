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
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, Pose
from teamslam.io.files.delimited import read_text
from teamslam.io.files.lines import Line, read_lines, read_pose, triangle
from teamslam.io.files.options import options_of
from teamslam.io.graphs.charts import inverse_chart, whitening_of_information
from teamslam.io.graphs.g2o_tags import EDGES, FORMS, NOTE, PARAMETERS, VERTICES, Tag
from teamslam.io.graphs.g2o_writer import write
from teamslam.io.graphs.graph import Edge, Whitener, matching, robots_of, tables_of, values_of
from teamslam.io.graphs.naming import names_in
from teamslam.io.graphs.symbols import LOWER_FIRST, fits, landmark_numbers, split_symbol
from teamslam.model import Dataset, Dropped, Kind, Names, Values, landmark_key, pack, pose_key

__all__ = ["Options", "read", "sniff", "write"]


@dataclass(frozen=True)
class Options:
    """What the reader may be told: whose chart the information of relative poses is in, 'g2o' or 'gtsam'."""

    chart: str = "g2o"


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
    for file in files:
        graph.add_file(file)
    return graph.dataset(str(path), half_angle=chosen.chart == "g2o")


@dataclass(frozen=True)
class _Vertex:
    """A vertex of a file: what it is, whose, which."""

    kind: Kind
    robot: int
    name: int  # the id as the file writes it
    state: tuple[float, ...]


@dataclass
class _Graph:
    """The content of the files read so far."""

    vertices: dict[tuple[int, int], _Vertex] = field(default_factory=dict)  # by place (`_place`) and id
    edges: list[tuple[int, Line]] = field(default_factory=list)  # with the number of the file
    sensors: list[Pose] = field(default_factory=list)
    parameters: dict[tuple[int, int, int], int] = field(default_factory=dict)  # file, dimension, id -> place in sensors
    robots: dict[int, str] = field(default_factory=dict)
    marks: dict[int, int] = field(default_factory=dict)  # the number of each landmark's id
    with_vertices: set[int] = field(default_factory=set)  # files that define vertices
    unknown: dict[str, int] = field(default_factory=dict)
    files: int = 0
    fixed: int = 0
    repeated: int = 0
    names: Names | None = None

    def add_file(self, path: Path) -> None:
        """All lines of one file."""
        self.files += 1
        self.names = self.names or _noted(path)
        own: set[tuple[bool, int]] = set()
        for line in read_lines(path):
            if line.tag in VERTICES:
                self._add_vertex(line, own)
            elif line.tag in EDGES:
                self.edges.append((self.files, line))
            elif line.tag in PARAMETERS:
                self._add_parameter(line)
            elif line.tag == "FIX":
                self.fixed += len(line.words)
            else:
                self.unknown[line.tag] = self.unknown.get(line.tag, 0) + 1

    def _add_vertex(self, line: Line, own: set[tuple[bool, int]]) -> None:
        kind = VERTICES[line.tag]
        self.with_vertices.add(self.files)
        form = FORMS[kind]
        line.check_length(1 + len(form.split()), form=f"{line.tag} id {form}")
        name = line.integer(0, "id")
        letter, count = split_symbol(name)
        if not 0 <= name < 1 << 63 or (kind.is_pose and not fits(count)):
            raise line.error(f"ids run from 0 to 2^51 - 1 (behind a letter in the top byte), found {name}", "id")
        if (kind.is_pose, name) in own:  # poses and landmarks may share plain ids
            raise line.error(f"vertex {name} stands twice in this file; give every vertex one line")
        own.add((kind.is_pose, name))
        robot = 0
        if kind.is_pose:
            robot = (LOWER_FIRST.robot(letter) or 0) if letter else self.files
            if not robot:
                raise line.error(f"the letter '{letter}' of a pose's id is no robot's (letters but L)", "id")
            self.robots.setdefault(robot, letter or line.path.stem)
        place = (self._place(name, kind), name)
        if place in self.vertices:
            self.repeated += 1
        else:
            self.vertices[place] = _Vertex(kind, robot, name, _state(line, 1, kind))

    def _place(self, name: int, kind: Kind) -> int:
        """Whose an id is: that of one file (a pose's plain id), the team's (a symbol, -1 for landmarks of plain id)."""
        if split_symbol(name)[0]:
            return 0
        return self.files if kind.is_pose else -1

    def _add_parameter(self, line: Line) -> None:
        dim = PARAMETERS[line.tag]
        form = "x y theta" if dim == 2 else "x y z qx qy qz qw"
        line.check_length(1 + len(form.split()), form=f"{line.tag} id {form}")
        sensor = read_pose(line, 1, dim)
        same = (k for k, s in enumerate(self.sensors) if s.dim == dim and not np.any(s.minus(sensor)))
        place = next(same, len(self.sensors))
        self.sensors += [sensor] if place == len(self.sensors) else []
        if self.parameters.setdefault((self.files, dim, line.integer(0, "id")), place) != place:
            raise line.error(f"parameter {line.words[0]} is defined twice in this file, and differently", "id")

    def _key(self, vertex: _Vertex) -> int:
        if vertex.kind.is_pose:
            return int(pose_key(vertex.robot, split_symbol(vertex.name)[1]))
        return int(landmark_key(self.marks[vertex.name]))

    # --- edges --------------------------------------------------------------------------------------------------------

    def dataset(self, origin: str, half_angle: bool) -> Dataset:
        """Everything as one Dataset."""
        if not self.edges:
            found = ", ".join(f"{tag[:60]} ({n})" for tag, n in self.unknown.items()) or "vertices alone"
            raise InputError(f"no line is an edge that teamslam knows; found {found}", path=origin)
        self.marks = landmark_numbers(v.name for v in self.vertices.values() if not v.kind.is_pose)
        edges, twice = self._edges()
        dims = robots_of(edges, self.robots)
        names = self.names or Names({robot: self._called(robot) for robot in dims}, {}, 1.0)
        dataset = Dataset(dims, tables_of(edges, _whitener(half_angle), self.sensors), names, origin=origin)
        initial, alone = matching(self._estimate(), dataset)
        return replace(dataset, initial=initial, dropped=self._dropped(twice, alone))

    def _called(self, robot: int) -> str:
        """A robot's name: its letter or its file's name."""
        return self.robots.get(robot) or str(LOWER_FIRST.letter(robot) or robot)

    def _estimate(self) -> Values | None:
        """The vertices; None where all lie at the origin, which is no estimate."""
        if all(not np.any(_from_origin(vertex)) for vertex in self.vertices.values()):
            return None
        return values_of({self._key(vertex): (vertex.kind, vertex.state) for vertex in self.vertices.values()})

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
            value = tuple(pack(read_pose(line, start, tag.dim)).tolist())
        else:
            value = tuple(line.floats(start, "xyz"[: tag.numbers] if tag.model != "bearing" else ["bearing"]))
        noise = line.symmetric(start + tag.numbers, tag.rows, "the information")
        return Edge(tag.model, tag.dim, keys, value, noise, line, self._sensor(line, tag, file))

    def _end(self, line: Line, at: int, kind: Kind, file: int) -> int:
        """The key of an edge's vertex, which must be known and of the right kind."""
        name = line.integer(at, "id")
        others = (other for other in range(1, self.files + 1) if other != file)
        found = [v for place in (0, -1, file, *others) if (v := self.vertices.get((place, name)))]
        vertex = next((v for v in found if v.kind is kind), found[0] if found else None)
        if vertex is None:
            return self._undefined(line, name, kind, file)
        if vertex.kind is not kind:
            raise line.error(f"vertex {name} is a {vertex.kind.name}, expected a {kind.name}", "id")
        return self._key(vertex)

    def _undefined(self, line: Line, name: int, kind: Kind, file: int) -> int:
        """The key of a vertex without a line: of a file without any, or of a robot whose file was not given."""
        letter, count = split_symbol(name)
        robot = LOWER_FIRST.robot(letter) if letter else file
        stranger = letter and robot not in self.robots
        if name < 0 or not fits(count) or not (stranger or file not in self.with_vertices):
            raise line.error(f"vertex {name} is not defined by any VERTEX line", "id")
        if not kind.is_pose:
            return int(landmark_key(self.marks.get(name, count)))
        if robot is None:
            raise line.error(f"the letter '{letter}' of a pose's id is no robot's (letters but L)", "id")
        return int(pose_key(robot, count))

    def _sensor(self, line: Line, tag: Tag, file: int) -> int | None:
        """The place of an edge's sensor among all; None for a sensor that is the body."""
        if not tag.parameter:
            return None
        name = line.integer(len(tag.ends), "parameter")
        place = self.parameters.get((file, tag.dim, name))
        if place is None:
            raise line.error(f"parameter {name} is not defined by any PARAMS_SE{tag.dim}OFFSET line", "parameter")
        if not np.any(self.sensors[place].minus(Pose.identity(tag.dim))):
            return None
        if len(tag.ends) == 1:
            raise line.error("an absolute measurement by a sensor that is not at the body's origin is not supported")
        return place

    def _dropped(self, twice: int, alone: int) -> tuple[Dropped, ...]:
        counts = [
            (twice, "edges that stand in the files of both their robots: one measurement each"),
            (self.repeated, "vertices that stand in several files: the first counts"),
            (alone, "vertices without an edge"),
            (self.fixed, "FIX lines: teamslam chooses the frame itself, all vertices are free"),
            *((n, f"lines with the unknown tag {tag[:60]}") for tag, n in self.unknown.items()),
        ]
        return tuple(Dropped(count, reason) for count, reason in counts if count)


def _from_origin(vertex: _Vertex) -> Array:
    """How a vertex differs from zero or the identity."""
    state, d = np.array(vertex.state), vertex.kind.dim
    if not vertex.kind.is_pose:
        return state
    return np.concatenate([state[:d], (state[d:].reshape(d, d) - np.eye(d)).ravel()])


def _state(line: Line, start: int, kind: Kind) -> tuple[float, ...]:
    """A vertex's row of the state vector."""
    if kind.is_pose:
        return tuple(pack(read_pose(line, start, kind.dim)).tolist())
    return tuple(line.floats(start, "xyz"[: kind.dim]))


def _whitener(half_angle: bool) -> Whitener:
    def whiten(model: str, dim: int, values: Array, information: Array) -> Array:
        if model in ("relative_pose", "pose"):
            inverse = inverse_chart(values, dim, half_angle)
            information = np.swapaxes(inverse, 1, 2) @ information @ inverse
        return whitening_of_information(information)

    return whiten


def _noted(path: Path) -> Names | None:
    """The names that a file of teamslam's own making carries in a comment."""
    first = read_text(path).partition("\n")[0]
    if not first.startswith(NOTE):
        return None
    try:
        return names_in(json.loads(first[len(NOTE) :]))
    except (ValueError, RecursionError):
        raise InputError("teamslam's note of names is damaged; remove the line", path=path, line=1) from None
