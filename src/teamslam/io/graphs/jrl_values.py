"""Values in JRL files: poses, points, bearings with ranges, as rows of teamslam's tables, and back."""

from collections.abc import Iterator, Sequence
from itertools import compress
from typing import Any

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.io.files.json_column import JsonColumn
from teamslam.io.files.json_place import Json
from teamslam.io.files.json_text import finite
from teamslam.io.graphs.jrl_factors import KINDS
from teamslam.model import Kind, pack, unpack


def by_kind(values: Json) -> Iterator[tuple[Kind, list[int], JsonColumn]]:
    """The values in a list of objects with a key, or a map from keys: each kind with its keys and values. Other types
    are passed over."""
    symbols, places = _keyed(values)
    kinds = [KINDS.get(name) for name in places.get("type").texts()]
    for kind in dict.fromkeys(kinds):
        if kind is not None:
            own = np.array([other is kind for other in kinds], bool)
            yield kind, list(compress(symbols, own)), places.select(own)


def last_of_each(parts: Sequence[tuple[IntArray, Array]]) -> tuple[IntArray, Array]:
    """Keys (n,), each once, and rows (n, ...): of a key that stands several times the last."""
    keys, rows = (np.concatenate(column)[::-1] for column in zip(*parts, strict=True))
    different, first = np.unique(keys, return_index=True)
    return different, rows[first]


def poses_or_points(places: JsonColumn, kind: Kind) -> Array:
    """Objects of type Pose2, Pose3, Point2 or Point3 as rows of the state vector (n, size)."""
    if kind is Kind.POSE2:
        return pack(Pose.from_xytheta(_entries(places, ("x", "y", "theta"))))
    if kind is Kind.POSE3:
        rotations = places.get("rotation")
        quaternions = rotations.rows(4)
        _check_length(rotations, quaternions, "a quaternion has length 1, found {} (w, x, y, z)")
        return pack(Pose.from_quaternion(places.get("translation").rows(3), quaternions))
    return _entries(places, "xyz"[: kind.dim])


def ranges(places: JsonColumn) -> Array:
    """Ranges (n,) [m], not negative."""
    found = _scalars(places)
    places.refuse(found < 0.0, lambda row: f"a range is not negative, found {float(found[row])}")
    return found


def bearings_ranges(places: JsonColumn, dim: int) -> Array:
    """Ranges, then bearings (n, 1 + ...): angles in the plane, unit vectors in space."""
    distances = ranges(places.get("range"))[:, None]
    bearings = places.get("bearing")
    out = np.empty((len(places), 1 if dim == 2 else 3))
    named = bearings.have("theta" if dim == 2 else "i")
    bare = bearings.select(~named)
    out[named] = _entries(bearings.select(named), ("theta",) if dim == 2 else "ijk")
    out[~named] = _scalars(bare)[:, None] if dim == 2 else bare.rows(3)
    if dim == 3:
        out /= _check_length(bearings, out, "a bearing in space is a unit vector, found one of length {}")[:, None]
    return np.concatenate([distances, out], -1)


def written(rows: Array, kind: Kind) -> list[dict[str, Any]]:
    """Rows (n, size) of the state vector as JSON. Law: poses_or_points(written(rows, kind), kind) = rows."""
    data = unpack(rows, kind)
    if not isinstance(data, Pose):
        return [{"type": f"Point{kind.dim}", **dict(zip("xyz", row, strict=False))} for row in finite(data)]
    if kind.dim == 2:
        return [{"type": "Pose2", "x": x, "y": y, "theta": theta} for x, y, theta in finite(data.xytheta())]
    places, turns = finite(data.translation), finite(data.quaternion_wxyz())
    return [{"type": "Pose3", "translation": t, "rotation": q} for t, q in zip(places, turns, strict=True)]


def written_ranges(distances: Array) -> list[dict[str, Any]]:
    """Ranges (n,) as JSON."""
    return [{"type": "Scalar", "value": distance} for distance in finite(distances)]


def written_bearings_ranges(values: Array, dim: int) -> list[dict[str, Any]]:
    """Ranges and bearings (n, 1 + ...) as JSON."""
    kind, names = ("Rot2", ("theta",)) if dim == 2 else ("Unit3", tuple("ijk"))
    bearings = [{"type": kind, **dict(zip(names, row, strict=True))} for row in finite(values[:, 1:])]
    return [
        {"type": "BearingRange", "bearing": bearing, "range": distance}
        for bearing, distance in zip(bearings, written_ranges(values[:, 0]), strict=True)
    ]


def _entries(places: JsonColumn, names: str | tuple[str, ...]) -> Array:
    """Numbers by name (n, len(names))."""
    return np.stack([places.get(name).numbers() for name in names], -1)


def _scalars(places: JsonColumn) -> Array:
    """Numbers (n,), bare or as {"type": "Scalar", "value": ...}."""
    out = np.empty(len(places))
    objects = places.are(dict)
    out[objects] = places.select(objects).get("value").numbers()
    out[~objects] = places.select(~objects).numbers()
    return out


def _check_length(places: JsonColumn, vectors: Array, problem: str) -> Array:
    """The lengths (n,) of what should be unit vectors (n, d). InputError where they are not."""
    lengths = np.linalg.norm(vectors, axis=-1)
    places.refuse(~((lengths > 0.9) & (lengths < 1.1)), lambda row: problem.format(f"{lengths[row]:.3g}"))
    return np.asarray(lengths)


def _keyed(values: Json) -> tuple[Sequence[int], JsonColumn]:
    if isinstance(values.value, dict):
        entries = values.items()
        symbols = [place.integer_of(name) for name, place in entries]
        return symbols, JsonColumn.of(values.path, [place for _, place in entries])
    places, _, _ = JsonColumn.of(values.path, [values]).elements()
    return places.get("key").wholes(), places
