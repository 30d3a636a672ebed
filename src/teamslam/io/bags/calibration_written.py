"""Calibrated cameras written as others read them, the kind told by the file's name:

    camera.yaml                 ROS (camera_info), as `camera_calibration` writes it
    camchain.yaml, *kalibr*     Kalibr
    *.xml, *opencv*.yaml        OpenCV (FileStorage)
    *photonvision*.json         PhotonVision
    *.json                      WPILib

Law: `read_camera` gives the same camera, to the bit. What a kind cannot say is an error: JSON knows no `equidistant`,
Kalibr no radial-tangential camera of other than four numbers.
"""

import json
from collections.abc import Callable
from pathlib import Path

from teamslam.errors import InputError
from teamslam.frontend.tags.camera import Camera
from teamslam.io.files.whole import whole_file

LENSES = {
    "radtan4": ("radtan", 4),
    "radtan5": ("radtan", 5),
    "radtan8": ("radtan", 8),
    "equidistant": ("equidistant", 4),
}
SAYS = {
    "Kalibr": (("radtan", 4), ("equidistant", 4)),
    "WPILib": (("radtan", 5), ("radtan", 8)),
    "PhotonVision": (("radtan", 5), ("radtan", 8)),
}
"""What some kinds of files can say; the others know every lens."""
ROS_MODELS = {"equidistant": "equidistant", "radtan": "plumb_bob"}


def lenses_of(path: Path, model: str | None = None) -> tuple[tuple[str, int], ...]:
    """The lenses (model, how many numbers of distortion) that a file of this name can say, the simplest first; with
    `model` (radtan4, radtan5, radtan8, equidistant) that one. InputError where it is unknown, or cannot be said."""
    _, words = kind_of(path)
    told = SAYS.get(words, (("radtan", 5), ("radtan", 8), ("equidistant", 4)))
    if model is None:
        return told
    if model not in LENSES:
        raise InputError(f"unknown model '{model}'; choose of {', '.join(LENSES)}", field="model")
    if words in SAYS and LENSES[model] not in told:
        raise InputError(f"{words} knows no camera of {model}; choose another model, or write ROS YAML", path=path)
    return (LENSES[model],)


def write_camera(camera: Camera, path: Path, name: str = "camera") -> str:
    """Write a camera as the kind of file that its name asks for; returns what kind that is, in words. InputError for an
    ending that is none of these, and for what the kind cannot say."""
    kind, words = kind_of(path)
    lens = camera.model, len(camera.distortion)
    if words in SAYS and lens not in SAYS[words] and camera.distortion:
        known = ", ".join(f"{model} {numbers}" for model, numbers in SAYS[words])
        raise InputError(f"{words} knows cameras of {known}, found {lens[0]} {lens[1]}; write ROS YAML", path=path)
    text = kind(camera, name)
    with whole_file(path) as file:
        file.write(text.encode())
    return words


def kind_of(path: Path) -> tuple[Callable[[Camera, str], str], str]:
    """How a file of this name is written, and what that is in words. InputError where the name says nothing."""
    name, ending = path.name.lower(), path.suffix.lower()
    if ending == ".json":
        return (_photonvision, "PhotonVision") if "photonvision" in name else (_wpilib, "WPILib")
    if ending == ".xml":
        return _opencv_xml, "OpenCV"
    if ending in (".yaml", ".yml"):
        if "camchain" in name or "kalibr" in name:
            return _kalibr, "Kalibr"
        return (_opencv_yaml, "OpenCV") if "opencv" in name else (_ros, "ROS camera_info")
    raise InputError("a camera is written as .yaml, .yml, .xml or .json", path=path)


def _ros(camera: Camera, name: str) -> str:
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    model = "rational_polynomial" if len(camera.distortion) == 8 else ROS_MODELS[camera.model]
    return (
        f"image_width: {camera.size[0]}\n"
        f"image_height: {camera.size[1]}\n"
        f"camera_name: {json.dumps(name)}\n"
        f"camera_matrix:\n{_block(3, 3, _matrix(camera))}"
        f"distortion_model: {model}\n"
        f"distortion_coefficients:\n{_block(1, len(camera.distortion), list(camera.distortion))}"
        f"rectification_matrix:\n{_block(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])}"
        f"projection_matrix:\n{_block(3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])}"
    )


def _kalibr(camera: Camera, name: str) -> str:
    return (
        "cam0:\n"
        "  camera_model: pinhole\n"
        f"  intrinsics: {_list([*camera.focal, *camera.centre])}\n"
        f"  distortion_model: {camera.model}\n"
        f"  distortion_coeffs: {_list(list(camera.distortion))}\n"
        f"  resolution: [{camera.size[0]}, {camera.size[1]}]\n"
        f"  rostopic: {json.dumps('/' + name.strip('/') + '/image_raw')}\n"
    )


def _opencv_yaml(camera: Camera, name: str) -> str:
    def matrix(rows: int, columns: int, numbers: list[float]) -> str:
        head = f"!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        return f"{head}   data: {_list(numbers)}\n"

    return (
        "%YAML:1.0\n---\n"
        f"image_width: {camera.size[0]}\n"
        f"image_height: {camera.size[1]}\n"
        f"distortion_model: {json.dumps(camera.model)}\n"
        f"camera_matrix: {matrix(3, 3, _matrix(camera))}"
        f"distortion_coefficients: {matrix(1, len(camera.distortion), list(camera.distortion))}"
    )


def _opencv_xml(camera: Camera, name: str) -> str:
    def matrix(called: str, rows: int, columns: int, numbers: list[float]) -> str:
        data = " ".join(map(repr, numbers))
        return (
            f'<{called} type_id="opencv-matrix">\n  <rows>{rows}</rows>\n  <cols>{columns}</cols>\n  <dt>d</dt>\n'
            f"  <data>{data}</data></{called}>\n"
        )

    return (
        '<?xml version="1.0"?>\n<opencv_storage>\n'
        f"<image_width>{camera.size[0]}</image_width>\n"
        f"<image_height>{camera.size[1]}</image_height>\n"
        f"<distortion_model>{camera.model}</distortion_model>\n"
        f"{matrix('camera_matrix', 3, 3, _matrix(camera))}"
        f"{matrix('distortion_coefficients', 1, len(camera.distortion), list(camera.distortion))}"
        "</opencv_storage>\n"
    )


def _wpilib(camera: Camera, name: str) -> str:
    return _json(
        {
            "camera_matrix": _matrix(camera),
            "distortion_coefficients": list(camera.distortion),
            "image_width": camera.size[0],
            "image_height": camera.size[1],
        }
    )


def _photonvision(camera: Camera, name: str) -> str:
    def matrix(rows: int, columns: int, numbers: list[float]) -> dict[str, object]:
        return {"rows": rows, "cols": columns, "type": 6, "data": numbers}

    return _json(
        {
            "resolution": {"width": float(camera.size[0]), "height": float(camera.size[1])},
            "cameraIntrinsics": matrix(3, 3, _matrix(camera)),
            "distCoeffs": matrix(1, len(camera.distortion), list(camera.distortion)),
            "calobjectWarp": [],
            "observations": [],
            "calobjectSize": {"width": 0.0, "height": 0.0},
            "calobjectSpacing": 0.0,
            "lensmodel": "LENSMODEL_OPENCV" if len(camera.distortion) == 5 else "LENSMODEL_OPENCV8",
        }
    )


def _matrix(camera: Camera) -> list[float]:
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]


def _block(rows: int, columns: int, numbers: list[float]) -> str:
    return f"  rows: {rows}\n  cols: {columns}\n  data: {_list(numbers)}\n"


def _list(numbers: list[float]) -> str:
    return "[" + ", ".join(_number(float(x)) for x in numbers) + "]"


def _number(x: float) -> str:
    """So that readers of YAML 1.1 and of OpenCV take it for a number: 1e-05 has a point."""
    text = repr(x)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _json(table: dict[str, object]) -> str:
    return json.dumps(table, indent=2) + "\n"
