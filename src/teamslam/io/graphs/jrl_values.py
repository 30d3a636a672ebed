"""Values in JRL files: poses, points, bearings with ranges, as rows of teamslam's tables, and back."""

from typing import Any

import numpy as np

from teamslam.geometry import Array, Pose
from teamslam.io.files.json_place import Json
from teamslam.model import Kind, pack, unpack


def keyed(values: Json) -> list[tuple[int, Json]]:
    """Values as a list of objects with a key, or as a map from keys."""
    if isinstance(values.value, dict):
        return [(place.integer_of(name), place) for name, place in values.items()]
    return [(place.get("key").whole(), place) for place in values.elements()]


def pose_or_point(place: Json, kind: Kind) -> tuple[float, ...]:
    """A Pose2, Pose3, Point2 or Point3 as a row of the state vector."""
    if kind is Kind.POSE2:
        return tuple(pack(Pose.from_xytheta(np.array([place.get(n).number() for n in ("x", "y", "theta")]))).tolist())
    if kind is Kind.POSE3:
        rotation = _numbers(place.get("rotation"), 4)
        length = float(np.linalg.norm(rotation))
        if not 0.9 < length < 1.1:
            raise place.get("rotation").error(f"a quaternion has length 1, found {length:.3g} (w, x, y, z)")
        return tuple(pack(Pose.from_quaternion(_numbers(place.get("translation"), 3), rotation)).tolist())
    return tuple(place.get(name).number() for name in "xyz"[: kind.dim])


def scalar(place: Json) -> float:
    """A number, bare or as {"type": "Scalar", "value": ...}."""
    return place.get("value").number() if isinstance(place.value, dict) else place.number()


def bearing_range(place: Json, dim: int) -> tuple[float, ...]:
    """Range, then bearing: an angle in the plane, a unit vector in space."""
    distance = scalar(place.get("range"))
    if distance < 0.0:
        raise place.get("range").error(f"a range is not negative, found {distance}")
    bearing = place.get("bearing")
    if dim == 2:
        return (distance, bearing.get("theta").number() if bearing.has("theta") else scalar(bearing))
    parts = [bearing.get(n).number() for n in "ijk"] if bearing.has("i") else _numbers(bearing, 3).tolist()
    length = float(np.linalg.norm(parts))
    if not 0.9 < length < 1.1:
        raise bearing.error(f"a bearing in space is a unit vector, found one of length {length:.3g}")
    return (distance, *(part / length for part in parts))


def written(row: Array, kind: Kind) -> dict[str, Any]:
    """A row of the state vector as JSON. Law: pose_or_point(written(row, kind), kind) = row."""
    data = unpack(row, kind)
    if not isinstance(data, Pose):
        return {"type": f"Point{kind.dim}", **dict(zip("xyz", data.tolist(), strict=False))}
    if kind.dim == 2:
        return {"type": "Pose2", **dict(zip(("x", "y", "theta"), data.xytheta().tolist(), strict=True))}
    return {
        "type": "Pose3",
        "translation": data.translation.tolist(),
        "rotation": data.quaternion_wxyz().tolist(),
    }


def written_range(distance: float) -> dict[str, Any]:
    """A range as JSON."""
    return {"type": "Scalar", "value": distance}


def written_bearing_range(value: Array, dim: int) -> dict[str, Any]:
    """A range and bearing as JSON."""
    bearing: dict[str, Any]
    if dim == 2:
        bearing = {"type": "Rot2", "theta": float(value[1])}
    else:
        bearing = {"type": "Unit3", **dict(zip("ijk", value[1:].tolist(), strict=True))}
    return {"type": "BearingRange", "bearing": bearing, "range": written_range(float(value[0]))}


def _numbers(place: Json, count: int) -> Array:
    numbers = [number.number() for number in place.elements()]
    if len(numbers) != count:
        raise place.error(f"expected {count} numbers, found {len(numbers)}")
    return np.array(numbers)
