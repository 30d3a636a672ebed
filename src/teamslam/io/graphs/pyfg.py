"""PyFG factor graphs (.pyfg): a multi-robot graph with true values, stamps and covariances, one record a line.

    VERTEX_SE2 t key x y theta                  VERTEX_SE3:QUAT t key x y z qx qy qz qw       true poses
    VERTEX_XY key x y                           VERTEX_XYZ key x y z                          true landmarks
    VERTEX_SE2:PRIOR t key x y theta C          VERTEX_SE3:QUAT:PRIOR t key ... C             absolute measurements
    VERTEX_XY:PRIOR t key x y C                 VERTEX_XYZ:PRIOR t key x y z C
    EDGE_SE2 t key key x y theta C              EDGE_SE3:QUAT t key key x y z qx qy qz qw C   relative poses
    EDGE_SE2_XY t key key x y C                 EDGE_SE3_XYZ t key key x y z C                landmarks
    EDGE_RANGE t key key range variance                                                       ranges

C is the upper triangle of a covariance, row by row, translation first; it is taken to be in teamslam's mixed chart, for
the format names none. A key is a letter and a count: A, B, C, ... are robots 1, 2, 3, ... (but L), L is landmarks.

Stamps: a pose has the stamp of its VERTEX line. Where all poses have one and a robot's stamps rise with its counts,
pose indices are microseconds; else they are counts and stamps are left out. Stamps of edges are not used.
Source: the format of PyFactorGraph, as its public readers and writers have it.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.io.files.lines import Line, read_lines, read_pose, state_words, text_of, triangle, write_text
from teamslam.io.files.options import options_of
from teamslam.io.graphs.charts import covariance_of_whitening
from teamslam.io.graphs.graph import Edge, matching, no_word_for, parts_of, robots_of, tables_of, values_of
from teamslam.io.graphs.symbols import UPPER_FIRST, fits
from teamslam.model import (
    SQUARED,
    Dataset,
    Dropped,
    Kind,
    Names,
    Table,
    index_of,
    is_pose,
    landmark_key,
    pack,
    pose_key,
    robot_of,
    whitening,
)

TICKS_PER_S = 1_000_000
KEY = re.compile(r"([A-Za-z])(\d{1,18})")


@dataclass(frozen=True)
class Tag:
    """One row of TAGS: a measurement's model and dimension (0: of its robots), and the kinds of its ends."""

    model: str
    dim: int
    ends: tuple[Kind, ...]


VERTICES: dict[str, Kind] = {
    "VERTEX_SE2": Kind.POSE2,
    "VERTEX_SE3:QUAT": Kind.POSE3,
    "VERTEX_XY": Kind.POINT2,
    "VERTEX_XYZ": Kind.POINT3,
}

TAGS: dict[str, Tag] = {
    "VERTEX_SE2:PRIOR": Tag("pose", 2, (Kind.POSE2,)),
    "VERTEX_SE3:QUAT:PRIOR": Tag("pose", 3, (Kind.POSE3,)),
    "VERTEX_XY:PRIOR": Tag("position", 2, (Kind.POINT2,)),
    "VERTEX_XYZ:PRIOR": Tag("position", 3, (Kind.POINT3,)),
    "EDGE_SE2": Tag("relative_pose", 2, (Kind.POSE2, Kind.POSE2)),
    "EDGE_SE3:QUAT": Tag("relative_pose", 3, (Kind.POSE3, Kind.POSE3)),
    "EDGE_SE2_XY": Tag("point", 2, (Kind.POSE2, Kind.POINT2)),
    "EDGE_SE3_XYZ": Tag("point", 3, (Kind.POSE3, Kind.POINT3)),
}
RANGE = "EDGE_RANGE"
FORMS = {Kind.POSE2: "x y theta", Kind.POSE3: "x y z qx qy qz qw", Kind.POINT2: "x y", Kind.POINT3: "x y z"}


@dataclass(frozen=True)
class Options:
    """What the reader may be told: whether to use the stamps of poses (else poses are counted)."""

    stamps: bool = True


@dataclass(frozen=True)
class _Name:
    """A key of the file: robot 0 is landmarks."""

    robot: int
    count: int


# --- reading ----------------------------------------------------------------------------------------------------------


def sniff(path: Path) -> bool:
    """A file *.pyfg."""
    return path.is_file() and path.suffix == ".pyfg"


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The measurements of a PyFG file; `options` as in `Options`.

    InputError names file, line and field of what cannot be read: keys that are none, a vertex given twice, covariances
    that are not positive definite, words that are no numbers, lines too short or too long.
    """
    chosen = options_of(Options, options, reader="pyfg")
    content = _Content()
    for line in read_lines(path):
        content.add(line)
    return content.dataset(str(path), chosen.stamps)


@dataclass
class _Content:
    """The lines of a file, sorted by what they are."""

    truth: dict[_Name, tuple[Kind, Sequence[float]]] = field(default_factory=dict)
    stamps: dict[_Name, float] = field(default_factory=dict)
    measured: list[Line] = field(default_factory=list)
    unknown: dict[str, int] = field(default_factory=dict)

    def add(self, line: Line) -> None:
        if line.tag in VERTICES:
            self._add_vertex(line)
        elif line.tag in TAGS or line.tag == RANGE:
            self.measured.append(line)
        else:
            self.unknown[line.tag] = self.unknown.get(line.tag, 0) + 1

    def _add_vertex(self, line: Line) -> None:
        kind = VERTICES[line.tag]
        start = 2 if kind.is_pose else 1
        line.check_length(
            start + len(FORMS[kind].split()), form=f"{line.tag} {'t key' if kind.is_pose else 'key'} {FORMS[kind]}"
        )
        name = _name(line, start - 1, kind)
        if name in self.truth:
            raise line.error(f"vertex {line.words[start - 1]} stands twice; give every vertex one line", "key")
        self.truth[name] = (kind, _row(line, start, kind))
        if kind.is_pose:
            self.stamps[name] = line.float(0, "t")

    def dataset(self, origin: str, use_stamps: bool) -> Dataset:
        """Everything as one Dataset."""
        found = [sighting for line in self.measured if (sighting := _sighting(line)) is not None]
        if not found:
            raise InputError(f"no line is a measurement ({', '.join([*TAGS, RANGE])})", path=origin)
        poses = {name for names, _ in found for name in names if name.robot}
        ticks = self._ticks(poses | set(self.stamps)) if use_stamps else None
        dims = {name.robot: kind.dim for name, (kind, _) in self.truth.items() if name.robot}
        dims |= {name.robot: edge.dim for names, edge in found if edge.model != "range" for name in names}
        edges = [
            replace(
                edge,
                keys=tuple(_key(name, ticks) for name in names),
                dim=dims.get(names[0].robot, 2) if edge.model == "range" else edge.dim,
            )
            for names, edge in found
        ]
        letters = {robot: str(UPPER_FIRST.letter(robot)) for robot in sorted({name.robot for name in poses})}
        robots = robots_of(edges, letters)
        tables = tables_of(edges, lambda model, dim, values, covariance: whitening(covariance))
        names = Names(letters, {}, 1.0 if ticks is None else 1.0 / TICKS_PER_S)
        dataset = Dataset(robots, tables, names, origin=origin)
        truth, alone = matching(values_of({_key(n, ticks): row for n, row in self.truth.items()}), dataset)
        unstamped = len(poses) if ticks is None and use_stamps and any(self.stamps.values()) else 0
        counts = [
            (alone, "vertices without a measurement"),
            (len(self.measured) - len(found), "ranges between two landmarks"),
            (unstamped, "stamps of poses: some are missing or do not rise with the counts, so poses are counted"),
            *((n, f"lines with the unknown tag {tag[:60]}") for tag, n in self.unknown.items()),
        ]
        return replace(dataset, truth=truth, dropped=tuple(Dropped(n, reason) for n, reason in counts if n))

    def _ticks(self, poses: Iterable[_Name]) -> dict[_Name, int] | None:
        """Each pose's stamp in microseconds; None where stamps cannot name the poses."""
        ordered = sorted(poses, key=lambda name: (name.robot, name.count))
        if not any(self.stamps.values()) or not all(name in self.stamps for name in ordered):
            return None
        ticks = {name: round(self.stamps[name] * TICKS_PER_S) for name in ordered}
        for before, after in pairwise(ordered):
            if before.robot == after.robot and ticks[after] <= ticks[before]:
                return None
        return ticks if all(map(fits, ticks.values())) else None


def _key(name: _Name, ticks: Mapping[_Name, int] | None) -> int:
    if not name.robot:
        return int(landmark_key(name.count))
    return int(pose_key(name.robot, name.count if ticks is None else ticks[name]))


def _sighting(line: Line) -> tuple[tuple[_Name, ...], Edge] | None:
    """A measurement and the names of its ends; None for a range that no robot measured."""
    if line.tag == RANGE:
        return _range(line)
    tag = TAGS[line.tag]
    start = 1 + len(tag.ends)
    kind = Kind(tag.dim - 2) if tag.model in ("relative_pose", "pose") else Kind(tag.dim)
    line.check_length(
        start + len(FORMS[kind].split()) + triangle(kind.dof),
        form=f"{line.tag} t {' '.join(['key'] * len(tag.ends))} {FORMS[kind]} and {triangle(kind.dof)} numbers of C",
    )
    line.float(0, "t")
    names = tuple(_name(line, 1 + k, end) for k, end in enumerate(tag.ends))
    if len(set(names)) != len(names):
        raise line.error(f"the measurement goes from {line.words[1]} to itself", "key")
    covariance = line.symmetric(start + len(FORMS[kind].split()), kind.dof, "the covariance")
    return names, Edge(tag.model, tag.dim, (), _row(line, start, kind), covariance, line)


def _range(line: Line) -> tuple[tuple[_Name, ...], Edge] | None:
    """A range from its robot, its dimension still open."""
    line.check_length(5, form=f"{RANGE} t key key range variance")
    line.float(0, "t")
    names = sorted((_name(line, at, None) for at in (1, 2)), key=lambda name: name.robot == 0)
    if names[0] == names[1]:
        raise line.error(f"the range goes from {line.words[1]} to itself", "key")
    if not names[0].robot:
        return None
    value, variance = line.floats(3, ("range", "variance"))
    if value < 0.0:
        raise line.error(f"a range is not negative, found {value}", "range")
    return tuple(names), Edge("range", 2, (), (value,), np.array([[variance]]), line)


def _name(line: Line, at: int, kind: Kind | None) -> _Name:
    """A key of the file, of a pose or a landmark as `kind` says (None: either)."""
    word = line.words[at]
    match = KEY.fullmatch(word)
    if not match or not fits(int(match.group(2))):
        raise line.error(f"expected a letter and a count such as A12 or L3, found '{word[:60]}'", "key")
    letter = match.group(1)
    is_mark = letter == UPPER_FIRST.landmark
    if kind is not None and kind.is_pose is is_mark:
        raise line.error(
            f"expected the key of a {'pose' if kind.is_pose else 'landmark (L...)'}, found '{word}'", "key"
        )
    return _Name(0 if is_mark else UPPER_FIRST.robot(letter) or 0, int(match.group(2)))


def _row(line: Line, start: int, kind: Kind) -> tuple[float, ...]:
    """A pose or point as a row of the state vector."""
    if kind.is_pose:
        return tuple(pack(read_pose(line, start, kind.dim)).tolist())
    return tuple(line.floats(start, "xyz"[: kind.dim]))


# --- writing ----------------------------------------------------------------------------------------------------------


def write(dataset: Dataset, path: Path) -> tuple[Dropped, ...]:
    """Writes a PyFG file and returns what it has no place for: estimates, losses, other names, stamps without truth.

    Law: `read` gives the same measurements and truth, and the same keys where every pose has a true value or poses are
    counted. InputError for sightings that the format has no tag for.
    """
    counts = _counts(dataset)
    stamped = dataset.names.tick_s != 1.0
    names = {key: _word(key, count) for key, count in counts.items()}
    lines = []
    truth = None if dataset.truth is None else matching(dataset.truth, dataset)[0]
    tags = {kind: tag for tag, kind in VERTICES.items()}
    missing = int(is_pose(dataset.layout.keys).sum())
    for kind, keys, data in () if truth is None else truth.parts():
        for key, row in zip(keys.tolist(), pack(data), strict=True):
            stamp = f"{_stamp(key, dataset)} " if kind.is_pose else ""
            lines.append(f"{tags[kind]} {stamp}{names[key]} {state_words(row, kind)}")
            missing -= kind.is_pose
    for table, ends in parts_of(dataset):
        lines += _measurements(table, ends, dataset, names)
    write_text(path, "\n".join(lines) + "\n")
    letters = {robot: str(UPPER_FIRST.letter(robot)) for robot in dataset.robots}
    others = {**{k: v for k, v in dataset.names.robots.items() if letters.get(k) != v}, **dataset.names.landmarks}
    losses = [
        (missing if stamped else 0, "stamps of poses without a true value: the poses are counted"),
        (0 if dataset.initial is None else len(dataset.initial), "estimates: PyFG holds true values only"),
        (sum(len(t) for t in dataset.tables if t.loss != SQUARED), "robust losses: PyFG has no place for them"),
        (len(others), "names: PyFG's are a letter and a count"),
    ]
    return tuple(Dropped(count, reason) for count, reason in losses if count)


def _counts(dataset: Dataset) -> dict[int, int]:
    """The count of each variable: its index where poses are counted, else its place among the robot's poses."""
    marks = {key: key for key in dataset.landmark_keys.tolist()}
    if dataset.names.tick_s == 1.0:
        return {**marks, **{k: int(index_of(k)) for keys in dataset.pose_keys.values() for k in keys.tolist()}}
    return {**marks, **{k: n for keys in dataset.pose_keys.values() for n, k in enumerate(keys.tolist())}}


def _word(key: int, count: int) -> str:
    robot = int(robot_of(key))
    letter = UPPER_FIRST.letter(robot) if robot else UPPER_FIRST.landmark
    if letter is None:
        raise InputError(f"robot {robot} has no letter in PyFG; number robots from 1 to {len(UPPER_FIRST.robots)}")
    return f"{letter}{count}"


def _stamp(key: int, dataset: Dataset) -> str:
    """A pose's stamp [s]; 0 where poses are counted."""
    return text_of(int(index_of(key)) * dataset.names.tick_s) if dataset.names.tick_s != 1.0 else "0.0"


def _measurements(table: Table, ends: tuple[Kind, ...], dataset: Dataset, names: Mapping[int, str]) -> list[str]:
    """The lines of one table."""
    tag = next((name for name, t in TAGS.items() if (t.model, t.dim, t.ends) == (table.model, table.dim, ends)), None)
    if table.model == "range" and {kind.dim for kind in ends} == {table.dim}:
        tag = RANGE
    if tag is None or table.sensor is not None:
        raise no_word_for(table, ends, "PyFG", "the plain format, or JRL for range and bearing")
    rows = table.row.residual_rows(table.dim)
    covariances = np.broadcast_to(covariance_of_whitening(table.whitening), (len(table), rows, rows))
    kind = Kind(table.dim - 2) if table.model in ("relative_pose", "pose") else Kind(table.dim)
    upper = np.triu_indices(rows)
    out = []
    for keys, value, covariance in zip(table.keys.tolist(), table.values, covariances, strict=True):
        measured = text_of(value[0]) if tag == RANGE else state_words(value, kind)
        stamp = _stamp(next((k for k in reversed(keys) if is_pose(k) and robot_of(k) == table.robot), keys[0]), dataset)
        numbers = " ".join(text_of(number) for number in covariance[upper])
        out.append(f"{tag} {stamp} {' '.join(names[key] for key in keys)} {measured} {numbers}")
    return out
