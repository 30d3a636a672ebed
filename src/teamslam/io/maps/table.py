"""Maps as one CSV for spreadsheets and pandas: a row a pose or landmark, with its covariance.

    component, frame     which of several maps; the key of the pose that is its frame, -1 for the world's
    kind, key            pose2, pose3, point2 or point3; the variable's number in teamslam (robot << 51 | tick)
    robot, stamp_s       of a pose                     landmark      of a landmark: what people call it
    x_m, y_m, z_m        where it is                   heading_rad   of a pose in the plane
    qw, qx, qy, qz       of a pose in space            cov_a_b       upper triangle of the covariance

Covariances are of the errors [x y heading] of planar poses, [x y z rx ry rz] of spatial ones (translation in the map's
frame, rotation in the body's own), [x y] or [x y z] of points. The base pose is the frame: its covariance is 0. Cells
that say nothing of a kind are empty; columns that no row uses are left out.
"""

import csv
import io
from collections.abc import Sequence
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.csv_file import Csv
from teamslam.io.files.delimited import any_csv
from teamslam.io.files.text import write_text
from teamslam.io.maps.estimate import MapEstimate
from teamslam.model import Dropped, Kind, Names, Values, index_of, is_pose, robot_of

PLACE = {2: ("x_m", "y_m"), 3: ("x_m", "y_m", "z_m")}
TURN = {2: ("heading_rad",), 3: ("qw", "qx", "qy", "qz")}
ERRORS = {
    Kind.POSE2: ("x", "y", "heading"),
    Kind.POSE3: ("x", "y", "z", "rx", "ry", "rz"),
    Kind.POINT2: ("x", "y"),
    Kind.POINT3: ("x", "y", "z"),
}
NAMES = ("component", "frame", "kind", "key", "robot", "stamp_s", "landmark")
HEADER = "component,frame,kind,key,"


def sniff(path: Path) -> bool:
    """A CSV file with these columns."""
    if path.suffix != ".csv" or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(HEADER)) == HEADER.encode()


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes all maps into one file. Law: `read` gives the same estimates, covariances, keys and names."""
    rows = [row for number, found in enumerate(maps, 1) for row in _rows(found, number)]
    used = {name for row in rows for name in row}
    header = [name for name in _columns() if name in used or name in NAMES]
    out = io.StringIO(newline="")
    writer = csv.DictWriter(out, header, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, out.getvalue())
    count = sum(len(found.values) for found in maps)
    return (Dropped(count, "variables whose correlations with others are left out: each has its own covariance"),)


def read(path: Path) -> list[MapEstimate]:
    """The maps in a file. InputError names the line and column of what cannot be read."""
    table = any_csv(path)
    components = table.numbers("component")[:, 0]
    if not len(components):
        raise InputError("the file holds no row", path=path)
    return [_read_map(_rows_at(table, np.flatnonzero(components == number))) for number in np.unique(components)]


def _columns() -> list[str]:
    """All columns in their order."""
    pairs = [pair for errors in ERRORS.values() for pair in _pairs(errors)]
    return [*NAMES, *PLACE[3], *TURN[2], *TURN[3], *dict.fromkeys(pairs)]


def _pairs(errors: Sequence[str]) -> list[str]:
    return [f"cov_{a}_{b}" for a, b in combinations_with_replacement(errors, 2)]


def _rows(found: MapEstimate, component: int) -> list[dict[str, str]]:
    """The rows of one map: poses in time order robot by robot, then landmarks."""
    rows: list[tuple[int, dict[str, str]]] = []
    blocks = found.covariances
    for kind, keys, data in found.values.parts():
        numbers = _numbers(data)
        header = _state_columns(kind)
        places = found.values.layout.index(keys)
        for key, row, place in zip(keys.tolist(), numbers.tolist(), places.tolist(), strict=True):
            cells = {"component": str(component), "frame": str(found.base), "kind": kind.name.lower(), "key": str(key)}
            if is_pose(key):
                cells |= {
                    "robot": found.names.robot(int(robot_of(key))),
                    "stamp_s": repr(float(found.names.stamps_s(key))),
                }
            else:
                cells["landmark"] = found.names.landmark(int(index_of(key)))
            cells |= dict(zip(header, map(repr, row), strict=True))
            if blocks is not None:
                upper = blocks[place][np.triu_indices(kind.dof)]
                cells |= dict(zip(_pairs(ERRORS[kind]), map(repr, upper.tolist()), strict=True))
            rows.append((key, cells))
    return [cells for _, cells in sorted(rows, key=lambda pair: (not is_pose(pair[0]), pair[0]))]


def _numbers(data: Pose | Array) -> Array:
    """Poses or points as the columns have them."""
    if not isinstance(data, Pose):
        return data
    return data.xytheta() if data.dim == 2 else np.concatenate([data.translation, data.quaternion_wxyz()], -1)


def _state_columns(kind: Kind) -> tuple[str, ...]:
    return PLACE[kind.dim] + (TURN[kind.dim] if kind.is_pose else ())


# --- reading ----------------------------------------------------------------------------------------------------------


def _read_map(table: Csv) -> MapEstimate:
    """The map of one component's rows."""
    kinds, keys = table.words("kind"), _whole(table, "key")
    known = {kind.name.lower(): kind for kind in Kind}
    of_kind: dict[Kind, list[int]] = {}
    for row in range(len(table)):
        if kinds[row] not in known:
            raise table.fail(row, f"expected {', '.join(known)}, found '{kinds[row]}'", "kind")
        of_kind.setdefault(known[kinds[row]], []).append(row)
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    blocks: dict[int, Array] = {}
    for kind, rows in of_kind.items():
        part, own = _rows_at(table, np.array(rows)), keys[rows]
        parts[kind] = own, _poses_or_points(part, kind)
        if part.has(*_pairs(ERRORS[kind])):
            blocks |= dict(zip(own.tolist(), _blocks(part, kind), strict=True))
    try:
        values = Values.of(parts)
        covariances = tuple(blocks[key] for key in values.layout.keys.tolist()) if len(blocks) == len(keys) else None
        return MapEstimate(values, covariances, int(_whole(table, "frame")[0]), _names(table, keys))
    except ModelError as error:
        raise InputError(str(error), path=table.path) from None


def _rows_at(table: Csv, rows: IntArray) -> Csv:
    """Some rows of a table."""
    columns = {name: [column[row] for row in rows.tolist()] for name, column in table.columns.items()}
    return Csv(table.path, columns, table.lines[rows])


def _whole(table: Csv, name: str) -> IntArray:
    """A column of keys."""
    words = table.words(name)
    try:
        return np.array([int(words[row]) for row in range(len(table))], np.int64)
    except (ValueError, OverflowError):
        bad = next(row for row in range(len(table)) if not words[row].lstrip("-").isdigit() or len(words[row]) > 19)
        raise table.fail(bad, f"expected a whole number, found '{words[bad]}'", name) from None


def _poses_or_points(part: Csv, kind: Kind) -> Pose | Array:
    numbers = part.numbers(*_state_columns(kind))
    if not kind.is_pose:
        return numbers
    if kind.dim == 2:
        return Pose.from_xytheta(numbers)
    lengths = np.linalg.norm(numbers[:, 3:], axis=-1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > 1e-3)
    if len(wrong):
        raise part.fail(int(wrong[0]), f"a unit quaternion has length 1, found {lengths[wrong[0]]:.4g}", "qw")
    return Pose.from_quaternion(numbers[:, :3], numbers[:, 3:])


def _blocks(part: Csv, kind: Kind) -> Array:
    """The covariances (n, dof, dof)."""
    above = np.triu_indices(kind.dof)
    blocks = np.zeros((len(part), kind.dof, kind.dof))
    blocks[:, above[0], above[1]] = part.numbers(*_pairs(ERRORS[kind]))
    return blocks + np.swapaxes(np.triu(blocks, 1), 1, 2)


def _names(table: Csv, keys: IntArray) -> Names:
    """What robots and landmarks are called where that is not their number, and how long a tick is."""
    robots: dict[int, str] = {}
    landmarks: dict[int, str] = {}
    poses = is_pose(keys)
    for row, key in enumerate(keys.tolist()):
        column, names, number = (
            ("robot", robots, int(robot_of(key))) if poses[row] else ("landmark", landmarks, int(index_of(key)))
        )
        name = table.columns[column][row] if table.has(column) else ""
        if name and name != str(number):
            names[number] = str(name)
    rows = np.flatnonzero(poses & (index_of(keys) > 0))
    if not len(rows) or not table.has("stamp_s"):
        return Names(robots, landmarks)
    last = rows[np.argmax(index_of(keys[rows]))]
    stamp = float(_rows_at(table, np.array([last])).numbers("stamp_s")[0, 0])
    tick_s = stamp / int(index_of(keys[last]))
    near = next((usual for usual in (1e-6, 1.0) if abs(tick_s - usual) <= 1e-9 * usual), tick_s)
    return Names(robots, landmarks, near)
