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
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.io.files.grid import Words
from teamslam.io.files.options import options_of
from teamslam.io.files.records import Records, read_records, triangle
from teamslam.io.graphs.edges import Edges, matching, robots_of, tables_of, values_of, whitened
from teamslam.io.graphs.pyfg_tags import RANGE, TAGS, TICKS_PER_S, VERTICES
from teamslam.io.graphs.pyfg_writer import lacks, write
from teamslam.io.graphs.symbols import UPPER_FIRST
from teamslam.io.graphs.tags import FORMS, Tag
from teamslam.model import Dataset, Dropped, Kind, Names, landmark_key, pose_key, whitening
from teamslam.model.keys import INDEX_BITS, MAX_INDEX

__all__ = ["Options", "lacks", "read", "sniff", "write"]

KEY = re.compile(r"([A-Za-z])(\d{1,18})")


@dataclass(frozen=True)
class Options:
    """What the reader may be told: whether to use the stamps of poses (else poses are counted)."""

    stamps: bool = True


def sniff(path: Path) -> bool:
    """A file *.pyfg."""
    return path.is_file() and path.suffix == ".pyfg"


def read(path: Path, options: Mapping[str, object] | None = None) -> Dataset:
    """The measurements of a PyFG file; `options` as in `Options`.

    InputError names file, line and field of what cannot be read: keys that are none, covariances that are not positive
    definite, words that are no numbers, lines too short or too long.
    """
    chosen = options_of(Options, options, reader="pyfg")
    content = _Content(path)
    for records in read_records(path):
        content.add(records)
    return content.dataset(chosen.stamps)


@dataclass(frozen=True, eq=False)
class _Vertices:
    """True values of one tag: counted keys (n,), rows of the state vector (n, size), stamps (n,) [s], 0 of points."""

    kind: Kind
    keys: IntArray
    states: Array
    stamps: Array


@dataclass
class _Content:
    """The lines of a file, sorted by what they are. Poses are called by their counts."""

    path: Path
    vertices: list[_Vertices] = field(default_factory=list)
    edges: list[Edges] = field(default_factory=list)
    ranges: list[Edges] = field(default_factory=list)
    between_landmarks: int = 0
    repeated: int = 0
    unknown: list[Dropped] = field(default_factory=list)

    def add(self, records: Records) -> None:
        if records.tag in VERTICES:
            self._add_vertices(records)
        elif records.tag in TAGS:
            self.edges.append(_measured(records, TAGS[records.tag]))
        elif records.tag == RANGE:
            found, between = _ranges(records)
            self.ranges.append(found)
            self.between_landmarks += between
        else:
            self.unknown.append(Dropped(len(records), f"lines with the unknown tag {records.tag[:60]}"))

    def _add_vertices(self, records: Records) -> None:
        kind, form = VERTICES[records.tag]
        start = 2 if kind.is_pose else 1
        names = FORMS[form].names
        records.check_length(
            start + len(names), form=f"{records.tag} {'t key' if kind.is_pose else 'key'} {' '.join(names)}"
        )
        keys = _keys(records, start - 1, kind.is_pose)
        stamps = records.floats(0, ("t",))[:, 0] if kind.is_pose else np.zeros(len(records))
        _, first = np.unique(keys, return_index=True)
        first = np.sort(first)
        self.repeated += len(keys) - len(first)
        self.vertices.append(_Vertices(kind, keys[first], FORMS[form].rows(records, start)[first], stamps[first]))

    def dataset(self, use_stamps: bool) -> Dataset:
        """Everything as one Dataset."""
        edges = [*self.edges, *self._ranges_in_their_dimension()]
        if not any(map(len, edges)):
            raise InputError(f"no line is a measurement ({', '.join([*TAGS, RANGE])})", path=self.path)
        counted = np.unique(np.concatenate([part.keys.ravel() for part in edges]))
        poses = counted[counted > MAX_INDEX]
        stamped = [(v.keys, v.stamps) for v in self.vertices if v.kind.is_pose]
        known, stamps = (np.concatenate(c) for c in zip(*stamped, strict=True)) if stamped else (poses[:0], np.zeros(0))
        ticks = _ticks(np.union1d(poses, known), known, stamps) if use_stamps else None
        edges = [replace(part, keys=_timed(part.keys, ticks)) for part in edges]
        letters = {robot: str(UPPER_FIRST.letter(robot)) for robot in np.unique(poses >> INDEX_BITS).tolist()}
        names = Names(letters, {}, 1.0 if ticks is None else 1.0 / TICKS_PER_S)
        dataset = Dataset(robots_of(edges, letters), tables_of(edges), names, origin=str(self.path))
        values = values_of((v.kind, _timed(v.keys, ticks), v.states) for v in self.vertices)
        truth, alone = matching(values, dataset)
        unstamped = len(poses) if ticks is None and use_stamps and np.any(stamps) else 0
        counts = [
            (self.repeated, "vertices that stand twice: the first counts"),
            (alone, "vertices without a measurement"),
            (self.between_landmarks, "ranges between two landmarks"),
            (unstamped, "stamps of poses: some are missing or do not rise with the counts, so poses are counted"),
        ]
        dropped = [Dropped(n, reason) for n, reason in counts if n]
        return replace(dataset, truth=truth, dropped=(*dropped, *self.unknown))

    def _ranges_in_their_dimension(self) -> list[Edges]:
        """The ranges, which have the dimension of their robots."""
        dims = np.full(1 << 12, 2)
        for kind, keys in [(v.kind, v.keys) for v in self.vertices if v.kind.is_pose]:
            dims[keys >> INDEX_BITS] = kind.dim
        for part in self.edges:
            dims[part.keys[part.keys > MAX_INDEX] >> INDEX_BITS] = part.dim
        found = []
        for part in self.ranges:
            of_robot = dims[part.keys[:, 0] >> INDEX_BITS]
            found += [replace(part.select(of_robot == dim), dim=dim) for dim in (2, 3) if (of_robot == dim).any()]
        return found


def _ticks(poses: IntArray, known: IntArray, stamps: Array) -> tuple[IntArray, IntArray] | None:
    """Counted poses and their stamps in microseconds; None where stamps cannot name the poses."""
    order = np.argsort(known, kind="stable")
    if not np.any(stamps) or not np.isin(poses, known).all():
        return None
    known, ticks = known[order], np.round(stamps[order] * TICKS_PER_S)
    same = np.diff(known >> INDEX_BITS) == 0
    if (np.diff(ticks)[same] <= 0).any() or (ticks < 0).any() or (ticks > MAX_INDEX).any():
        return None
    return known, np.asarray(known >> INDEX_BITS << INDEX_BITS | ticks.astype(np.int64))


def _timed(keys: IntArray, ticks: tuple[IntArray, IntArray] | None) -> IntArray:
    """Counted keys (any shape) with the poses' stamps in place of their counts."""
    if ticks is None:
        return keys
    known, stamped = ticks
    poses = keys > MAX_INDEX
    out = keys.copy()
    out[poses] = stamped[np.searchsorted(known, keys[poses])]
    return out


def _measured(records: Records, tag: Tag) -> Edges:
    """The measurements of one tag."""
    form = FORMS[tag.form]
    start, rows = 1 + len(tag.ends), tag.rows
    records.check_length(
        start + len(form.names) + triangle(rows),
        form=f"{records.tag} t {'key ' * len(tag.ends)}{' '.join(form.names)} and {triangle(rows)} numbers of C",
    )
    records.floats(0, ("t",))
    keys = np.stack([_keys(records, 1 + k, end.is_pose) for k, end in enumerate(tag.ends)], -1)
    if len(tag.ends) == 2:
        records.refuse(keys[:, 0] == keys[:, 1], "the measurement goes from {1} to itself", "key")
    covariance = records.symmetric(start + len(form.names), rows, "the covariance")
    return _edges(records, tag.model, tag.dim, keys, form.rows(records, start), covariance)


def _ranges(records: Records) -> tuple[Edges, int]:
    """Ranges from their robots, their dimension still open, and how many no robot measured."""
    records.check_length(5, form=f"{RANGE} t key key range variance")
    records.floats(0, ("t",))
    keys = np.stack([_keys(records, at, None) for at in (1, 2)], -1)
    records.refuse(keys[:, 0] == keys[:, 1], "the range goes from {1} to itself", "key")
    numbers = records.floats(3, ("range", "variance"))
    records.refuse(numbers[:, 0] < 0.0, "a range is not negative, found {3}", "range")
    from_landmark = keys[:, 0] <= MAX_INDEX
    keys[from_landmark] = keys[from_landmark, ::-1]
    measured = keys[:, 0] > MAX_INDEX
    found = _edges(records, "range", 2, keys, numbers[:, :1], numbers[:, 1:, None])
    return found.select(measured), int((~measured).sum())


def _edges(records: Records, model: str, dim: int, keys: IntArray, values: Array, covariance: Array) -> Edges:
    whitening_here = whitened(whitening, covariance, records.error)
    body = np.full(len(keys), -1)
    return Edges(model, dim, keys, values, whitening_here, records.lines, body, records.error)


def _keys(records: Records, at: int, pose: bool | None) -> IntArray:
    """The keys of counted poses or of landmarks, as `pose` says (None: either)."""
    words = Words.of(records.column(at))
    found = [KEY.fullmatch(name) for name in words.names]
    bad = np.array([match is None or int(match[2]) > MAX_INDEX for match in found], bool)
    records.refuse(bad[words.codes], f"expected a letter and a count such as A12 or L3, found '{{{at}}}'", "key")
    letters = np.array([ord(match[1]) for match in found if match], np.int64)
    counts = np.array([int(match[2]) for match in found if match], np.int64)
    is_mark: BoolArray = letters == ord(UPPER_FIRST.landmark)
    if pose is not None:
        expected = "pose" if pose else "landmark (L...)"
        records.refuse((is_mark == pose)[words.codes], f"expected the key of a {expected}, found '{{{at}}}'", "key")
    keys = landmark_key(counts)
    keys[~is_mark] = pose_key(UPPER_FIRST.numbers(letters[~is_mark]), counts[~is_mark])
    return keys[words.codes]
