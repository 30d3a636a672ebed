"""Calibrated cameras from the files that people have: ROS, OpenCV (and XML), Kalibr and TagSLAM (YAML), WPILib and
PhotonVision (JSON), and from `camera_info` in a recording.

A file that holds several cameras is asked for the one whose topic is at hand, or by its name in the file.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.frontend.tags.camera import Camera
from teamslam.io.bags.opened import Recording

MODELS = {
    "plumb_bob": "radtan",
    "rational_polynomial": "radtan",
    "radtan": "radtan",
    "radial-tangential": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "kannala_brandt": "equidistant",
    "none": "radtan",
    "": "radtan",
}
MATRIX = ("camera_matrix", "cameraMatrix", "cameraIntrinsics", "K", "k", "intrinsic_matrix")
NUMBERS = ("distortion_coefficients", "distCoeffs", "cameraExtrinsics", "D", "d", "dist_coeffs", "distortion_coeffs")


def read_camera(path: Path, name: str | None = None, topics: Sequence[str] = ()) -> Camera:
    """The camera in a calibration file; of several the one called `name`, else that of one of the `topics`, or of one
    beside it (/left/tags, /left/image_raw). InputError where the file holds none, or none of these."""
    table = parsed(path)
    several = {k: v for k, v in table.items() if isinstance(v, Mapping) and "intrinsics" in v}
    if not several:
        return _camera(table, path)
    if name is not None and name not in several:
        raise InputError(f"there is no camera '{name}'; this file has {', '.join(several)}", path=path)
    own = {k: {str(v[key]) for key in ("rostopic", "tagtopic") if key in v} for k, v in several.items()}
    fitting = [k for k, theirs in own.items() if theirs & set(topics)]
    fitting = fitting or [k for k, theirs in own.items() if _folders(theirs) & _folders(topics)]
    if name is None and len(fitting) != 1 and len(several) > 1:
        raise InputError(
            f"this file has several cameras, {', '.join(several)}; say which with calibration_name", path=path
        )
    return _kalibr(several[name or (fitting or list(several))[0]], path)


def _folders(topics: Iterable[str]) -> set[str]:
    """What the names of topics begin with, up to their last part."""
    return {folder for topic in topics if (folder := topic.strip("/").rpartition("/")[0])}


def camera_in(recording: Recording, topic: str, *, rectified: bool = False) -> Camera:
    """The camera of the first `camera_info` on a topic that is calibrated; of images that were `rectified` by it, which
    its P is of and no distortion. InputError where there is none."""
    if topic not in recording.topics:
        listing = ", ".join(n for n, (types, _) in recording.topics.items() if "CameraInfo" in types[0]) or "none"
        raise InputError(f"there is no topic {topic}; of camera_info this recording has {listing}", path=recording.path)
    for message in recording.messages([topic]):
        found = recording.decode(message)
        matrix = np.asarray(getattr(found, "K", getattr(found, "k", ())), float).ravel()
        if len(matrix) == 9 and matrix[0] > 0.0:
            numbers = np.asarray(getattr(found, "D", getattr(found, "d", ())), float).ravel()
            size = int(getattr(found, "width", 0)), int(getattr(found, "height", 0))
            if rectified:
                p = np.asarray(getattr(found, "P", getattr(found, "p", ())), float).ravel()
                if len(p) != 12 or not p[0] > 0.0:
                    raise InputError(f"{topic} says nothing of rectified images (its P is zero)", path=recording.path)
                return _made(p.reshape(3, 4)[:, :3].ravel(), np.zeros(0), "", size, recording.path)
            return _made(matrix, numbers, str(getattr(found, "distortion_model", "")), size, recording.path)
    raise InputError(f"{topic} holds no calibrated camera (its K is zero, or nothing came)", path=recording.path)


def parsed(path: Path) -> Mapping[str, Any]:
    """The table in a file of YAML (also as OpenCV writes it), JSON, or OpenCV's XML. InputError where it holds none."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError("not a text file; expected a calibration in YAML or JSON", path=path) from None
    except OSError as error:
        raise InputError(f"the calibration cannot be read: {error.strerror or error}", path=path) from None
    try:
        table = _READERS.get(text.lstrip()[:1], _yaml)(text)
    except MissingExtraError:
        raise
    except Exception as error:  # the parsers' own, of many kinds
        raise InputError(f"neither YAML, JSON nor XML: {str(error).splitlines()[0]}", path=path) from None
    if not isinstance(table, Mapping):
        raise InputError("expected names with values at the top, as a calibration has them", path=path)
    return table


def _yaml(text: str) -> Any:
    """YAML, also as OpenCV writes it: its first line and its tag for matrices are its own."""
    try:
        from ruamel.yaml import YAML
    except ImportError:
        raise MissingExtraError("calibrations in YAML need the extra: `pip install teamslam[bags]`") from None
    text = re.sub(r"^%YAML:.*$", "", text, count=1, flags=re.MULTILINE).replace("!!opencv-matrix", "")
    return YAML(typ="safe", pure=True).load(text)


def _xml(text: str) -> Any:
    """OpenCV's XML: each entry a text, or a matrix with its data."""
    from xml.etree import ElementTree

    if "<!" in text:
        raise ValueError("declarations are not read")
    return {
        entry.tag: {"data": (entry.findtext("data") or "").split()} if len(entry) else (entry.text or "").strip()
        for entry in ElementTree.fromstring(text)
    }


_READERS: dict[str, Callable[[str], Any]] = {"{": json.loads, "<": _xml}


def _camera(table: Mapping[str, Any], path: Path) -> Camera:
    """A file with one camera: a matrix of 3 x 3 and distortion, under whatever names."""
    matrix = _first(table, MATRIX)
    if matrix is None:
        raise InputError(f"no camera in it: expected one of {', '.join(MATRIX)}, or cameras with intrinsics", path=path)
    numbers = _first(table, NUMBERS)
    shape = table.get("resolution") or {}
    size = (shape.get("width", 0), shape.get("height", 0)) if isinstance(shape, Mapping) else tuple(shape)
    if not any(size):
        size = table.get("image_width", 0), table.get("image_height", 0)
    flat = _numbers(numbers, path) if numbers is not None else np.zeros(0)
    return _made(_numbers(matrix, path), flat, str(table.get("distortion_model", "")), size, path)


def _kalibr(entry: Mapping[str, Any], path: Path) -> Camera:
    """A camera as Kalibr and TagSLAM write it: intrinsics fx, fy, cx, cy."""
    if (kind := str(entry.get("camera_model", "pinhole"))) != "pinhole":
        raise InputError(
            f"camera model '{kind}' is not known; calibrate with pinhole-radtan or pinhole-equi", path=path
        )
    four = _numbers(entry["intrinsics"], path)
    if len(four) != 4:
        raise InputError(f"intrinsics are fx, fy, cx, cy; found {len(four)} numbers", path=path)
    matrix = np.array([four[0], 0.0, four[2], 0.0, four[1], four[3], 0.0, 0.0, 1.0])
    numbers = _numbers(entry.get("distortion_coeffs", []), path)
    size = tuple(entry.get("resolution", (0, 0)))
    return _made(matrix, numbers, str(entry.get("distortion_model", "")), size, path)


def _made(matrix: np.ndarray, numbers: np.ndarray, model: str, size: Sequence[Any], path: Path) -> Camera:
    known = MODELS.get(model.lower())
    if known is None:
        raise InputError(f"unknown distortion model '{model}'; known are {', '.join(filter(None, MODELS))}", path=path)
    if len(matrix) != 9:
        raise InputError(f"a camera's matrix has 9 numbers, found {len(matrix)}", path=path)
    if len(numbers) in (12, 14) and not numbers[8:].any():
        numbers = numbers[:8]
    if known == "radtan" and len(numbers) < 4:
        numbers = np.concatenate([numbers, np.zeros(4 - len(numbers))])
    try:
        return Camera(
            (float(matrix[0]), float(matrix[4])),
            (float(matrix[2]), float(matrix[5])),
            known,
            tuple(numbers.tolist()),
            (int(size[0]), int(size[1])) if len(size) == 2 else (0, 0),
        )
    except InputError as error:
        raise InputError(error.problem, path=path) from None


def _first(table: Mapping[str, Any], names: Sequence[str]) -> Any:
    return next((table[name] for name in names if name in table), None)


def _numbers(value: Any, path: Path) -> np.ndarray:
    try:
        return np.asarray(value["data"] if isinstance(value, Mapping) else value, float).ravel()
    except (TypeError, ValueError, KeyError):
        raise InputError(f"expected numbers, found {str(value)[:60]}", path=path) from None
