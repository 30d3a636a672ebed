"""The files of one team's graph, each read by itself, as one Dataset.

    whose   every id becomes a variable of a robot or of the team                       owners
    once    vertices that stand twice: the first counts; measurements that stand in the files of both their robots, or
            twice in files put together: one each
    known   a measurement names vertices that are there, and of the right kind

What is left out is counted in `Dataset.dropped`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import BoolArray, IntArray, Pose
from teamslam.io.graphs.edges import Edges, matching, robots_of, tables_of, values_of
from teamslam.io.graphs.owners import Owners, owners_of
from teamslam.io.graphs.part import Measured, Part, Vertices
from teamslam.io.graphs.symbols import LOWER_FIRST, split_symbols
from teamslam.model import Dataset, Dropped, Kind, Names, Values, robot_of
from teamslam.model.keys import MAX_ROBOT


@dataclass(frozen=True, eq=False)
class _Known:
    """The vertices of all files, each once: keys (n,) rising, kinds (n,) and rows of the state vector by kind."""

    points: IntArray  # (n,): keys of points
    point_kinds: IntArray
    poses: IntArray
    pose_kinds: IntArray
    estimate: Values | None
    robots: BoolArray  # (4096,): the robots that have vertices
    repeated: int  # in one file
    elsewhere: int  # in several

    def look_up(self, keys: IntArray, kind: Kind) -> tuple[BoolArray, IntArray]:
        """Which keys (n,) are vertices of the class of `kind`, poses or points, and of what kind (-1: none)."""
        known, kinds = (self.poses, self.pose_kinds) if kind.is_pose else (self.points, self.point_kinds)
        if not len(known):
            return np.zeros(len(keys), bool), np.full(len(keys), -1)
        at = np.minimum(np.searchsorted(known, keys), len(known) - 1)
        there = known[at] == keys
        return there, np.where(there, kinds[at], -1)


def assemble(parts: Sequence[Part], origin: str) -> Dataset:
    """Everything in some files as one Dataset.

    InputError, with file and line, for a measurement whose vertex is nowhere or of the wrong kind, from a variable to
    itself, or of a robot that moves in the plane and in space.
    """
    if not any(len(measured) for part in parts for measured in part.measured):
        raise InputError(f"no line is a measurement that teamslam knows; found {_found(parts)}", path=origin)
    owners = owners_of(parts)
    known = _known(parts, owners)
    sensors, places = _sensors(parts)
    edges = list(_edges(parts, owners, known, places))
    edges, twice = _once(edges, [number for number, part in enumerate(parts) for _ in part.measured])
    dims = robots_of(edges, owners.robots)
    names = next((part.names for part in parts if part.names is not None), None)
    names = names or Names({robot: owners.robots.get(robot, str(robot)) for robot in dims}, {}, 1.0)
    dataset = Dataset(dims, tables_of(edges, sensors), names, origin=origin)
    initial, alone = matching(known.estimate, dataset)
    truth, _ = matching(_true_values(parts, owners), dataset)
    counts = [
        (_fixed(parts, dataset), "vertices held by FIX lines: one only chooses the frame, which teamslam does itself"),
        (twice, "edges that stand in the files of both their robots, or twice: one measurement each"),
        (known.repeated, "vertices that stand twice in a file: the first counts"),
        (known.elsewhere, "vertices that stand in several files: the first counts"),
        (alone, "vertices without an edge"),
    ]
    dropped = [Dropped(count, reason) for count, reason in counts if count]
    notes = dict.fromkeys(note for note in (owners.note, *(n for part in parts for n in part.notes)) if note)
    return replace(dataset, initial=initial, truth=truth, dropped=(*dropped, *_together(parts)), notes=tuple(notes))


def _found(parts: Sequence[Part]) -> str:
    tags = [drop.reason for part in parts for drop in part.dropped]
    return "; ".join(tags) or ("vertices alone" if any(part.vertices for part in parts) else "none")


def _fixed(parts: Sequence[Part], dataset: Dataset) -> int:
    """How many vertices FIX lines hold: one of a file, which only chooses its frame. InputError where it is more than
    that: two of a file, or one beside measurements in the world."""
    held = [{word for records in part.fixed for words in records.words for word in words} for part in parts]
    most = max(map(len, held), default=0)
    if most > 1 or (most and any(table.row.unary for table in dataset.tables)):
        records = next(records for part, names in zip(parts, held, strict=True) for records in part.fixed
                       if len(names) == most)  # fmt: skip
        raise records.error(
            len(records) - 1,
            "vertices that are held are more than a choice of the frame here, and teamslam does not hold vertices: "
            "remove the FIX lines, or write an EDGE_PRIOR line for each with how well it is known",
        )
    return sum(map(len, held))


def _together(parts: Sequence[Part]) -> list[Dropped]:
    """What was left out of all files, by reason."""
    counts: dict[str, int] = {}
    for drop in (drop for part in parts for drop in part.dropped):
        counts[drop.reason] = counts.get(drop.reason, 0) + drop.count
    return [Dropped(count, reason) for reason, count in counts.items()]


# --- vertices ---------------------------------------------------------------------------------------------------------


def _known(parts: Sequence[Part], owners: Owners) -> _Known:
    """All vertices, the first of those that stand several times."""
    keys, kinds, rows, files = [], [], [], []
    for number, part in enumerate(parts):
        for vertices in part.vertices:
            keys.append(_keys_of(vertices, number, owners))
            kinds.append(np.full(len(vertices.ids), int(vertices.kind)))
            rows.append(vertices.states)
            files.append(np.full(len(vertices.ids), number))
    robots = np.zeros(MAX_ROBOT + 1, bool)
    if not keys:
        none = np.zeros(0, np.int64)
        return _Known(none, none, none, none, None, robots, 0, 0)
    key, kind, file = (np.concatenate(found) for found in (keys, kinds, files))
    first, repeated, elsewhere = _first(key, kind, file)
    starts = np.cumsum([0, *map(len, keys)])
    estimate = values_of(
        (Kind(int(k[0])), keys[n][first[a:b]], rows[n][first[a:b]])
        for n, (k, a, b) in enumerate(zip(kinds, starts[:-1], starts[1:], strict=True))
        if len(k)
    )
    key, kind = key[first], kind[first]
    order = np.argsort(key, kind="stable")
    key, kind = key[order], kind[order]
    poses = kind < Kind.POINT2
    robots[robot_of(key[poses & (robot_of(key) > 0)])] = True
    return _Known(
        key[~poses], kind[~poses], key[poses], kind[poses], None if _at_origin(estimate) else estimate,
        robots, repeated, elsewhere,
    )  # fmt: skip


def _first(keys: IntArray, kinds: IntArray, files: IntArray) -> tuple[BoolArray, int, int]:
    """Which vertices are the first of their key and class, and how many others stand in the same file or another."""
    told = np.stack([keys, kinds < Kind.POINT2], -1)
    _, first, which = np.unique(told, axis=0, return_index=True, return_inverse=True)
    kept = np.zeros(len(keys), bool)
    kept[first] = True
    elsewhere = int((files != files[first][which.ravel()]).sum())
    return kept, int((~kept).sum()) - elsewhere, elsewhere


def _keys_of(vertices: Vertices, file: int, owners: Owners) -> IntArray:
    if vertices.kind.is_pose:
        return owners.poses(file, vertices.ids, vertices.records)
    return owners.points(vertices.ids)


def _at_origin(estimate: Values | None) -> bool:
    """True where all vertices lie at the origin, which is no estimate."""
    if estimate is None:
        return True
    for kind, _, data in estimate.parts():
        away = data.minus(Pose.identity(kind.dim, (len(data),))) if isinstance(data, Pose) else data
        if np.any(away):
            return False
    return True


def _true_values(parts: Sequence[Part], owners: Owners) -> Values | None:
    stated = [(n, vertices) for n, part in enumerate(parts) for vertices in part.truth]
    return values_of((v.kind, _keys_of(v, number, owners), v.states) for number, v in stated)


# --- measurements -----------------------------------------------------------------------------------------------------


def _edges(parts: Sequence[Part], owners: Owners, known: _Known, places: Sequence[IntArray]) -> Iterator[Edges]:
    """Each file's measurements with the keys of their variables, in the order of the files."""
    before = 0
    for number, part in enumerate(parts):
        for measured in part.measured:
            keys = np.stack([_ends(measured, k, number, owners) for k in range(len(measured.ends))], -1)
            if len(measured.ends) == 2:
                measured.records.refuse(keys[:, 0] == keys[:, 1], "the edge goes from vertex {0} to itself")
            _refuse_unknown(measured, keys, known, parts, {vertices.kind.is_pose for vertices in part.vertices})
            sensor = np.append(places[number], -1)[measured.sensor]
            yield Edges(
                measured.model, measured.dim, keys, measured.values, measured.whitening,
                before + measured.records.lines, sensor, measured.records.error,
            )  # fmt: skip
        before += max((int(measured.records.lines.max(initial=0)) for measured in part.measured), default=0) + 1


def _ends(measured: Measured, k: int, file: int, owners: Owners) -> IntArray:
    """The keys of the k-th variables of measurements."""
    if measured.ends[k].is_pose:
        return owners.poses(file, measured.ids[:, k], measured.records, k)
    return owners.points(measured.ids[:, k])


def _refuse_unknown(
    measured: Measured, keys: IntArray, known: _Known, parts: Sequence[Part], defines: set[bool]
) -> None:
    """InputError at a measurement of a vertex of another kind, or of one that is nowhere though its file defines
    others: `defines` says whether it does so of poses (True) and of points. What belongs to a robot whose file was not
    given may be nowhere."""
    for k, end in enumerate(measured.ends):
        there, kinds = known.look_up(keys[:, k], end)
        letters, _ = split_symbols(measured.ids[:, k])
        owner = np.where(letters > 0, LOWER_FIRST.numbers(letters), robot_of(keys[:, k]))
        strange = ~known.robots[owner] & ((letters > 0) | end.is_pose)
        missing = ~there & ~strange & (end.is_pose in defines)
        bad = np.flatnonzero((there & (kinds != end)) | missing)
        if len(bad):
            row = int(bad[0])
            found = _kind_of(int(measured.ids[row, k]), parts) if not there[row] else Kind(int(kinds[row]))
            problem = (
                "is not defined by any VERTEX line" if found is None else f"is a {found.name}, expected a {end.name}"
            )
            raise measured.records.error(row, f"vertex {measured.ids[row, k]} {problem}", "id")


def _kind_of(name: int, parts: Sequence[Part]) -> Kind | None:
    """What some file says that a vertex is."""
    found = (v.kind for part in parts for v in part.vertices if (v.ids == name).any())
    return next(found, None)


def _once(edges: Sequence[Edges], files: Sequence[int]) -> tuple[list[Edges], int]:
    """The measurements, each once, and how many stood twice: in two files, or between two robots in one."""
    seen: dict[bytes, int] = {}
    kept, twice = [], 0
    for part, file in zip(edges, files, strict=True):
        robots = robot_of(part.keys)
        between = (robots > 0).all(1) & (robots[:, 0] != robots[:, -1])
        rows = np.arange(len(part)) if len(set(files)) > 1 else np.flatnonzero(between)
        fresh = np.ones(len(part), bool)
        for row, content in zip(rows.tolist(), _contents(part, rows), strict=True):
            known = seen.get(content)
            fresh[row] = known is None or (known == file and not between[row])
            seen.setdefault(content, file)
        twice += int((~fresh).sum())
        kept.append(part if fresh.all() else part.select(fresh))
    return kept, twice


def _contents(part: Edges, rows: IntArray) -> Iterator[bytes]:
    """All that measurements say, to the bit."""
    told = f"{part.model} {part.dim} ".encode()
    columns = (part.keys, part.sensor, part.values, part.whitening)
    flat = [column[rows].reshape(len(rows), column[0].size) for column in columns] if len(rows) else []
    for row in zip(*flat, strict=True):
        yield told + b"".join(column.tobytes() for column in row)


def _sensors(parts: Sequence[Part]) -> tuple[list[Pose], list[IntArray]]:
    """The sensors of all files, equal ones once, and where each file's are among them."""
    sensors: list[Pose] = []
    places = []
    for part in parts:
        own = []
        for sensor in part.sensors:
            same = (k for k, s in enumerate(sensors) if s.dim == sensor.dim and not np.any(s.minus(sensor)))
            own.append(next(same, len(sensors)))
            sensors += [sensor] if own[-1] == len(sensors) else []
        places.append(np.array(own, np.int64))
    return sensors, places
