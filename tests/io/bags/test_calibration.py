"""One camera, as each program writes it, is one camera."""

import json

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.frontend.tags.camera import Camera
from teamslam.io.bags.calibration import read_camera

CAMERA = Camera((600.5, 610.25), (320.0, 240.5), "radtan", (-0.2, 0.1, 0.001, -0.002, 0.01), (640, 480))
K = [600.5, 0.0, 320.0, 0.0, 610.25, 240.5, 0.0, 0.0, 1.0]
D = [-0.2, 0.1, 0.001, -0.002, 0.01]

FILES = {
    "ros.yaml": f"""image_width: 640
image_height: 480
camera_name: front
camera_matrix: {{rows: 3, cols: 3, data: {K}}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: {D}}}
projection_matrix: {{rows: 3, cols: 4, data: {[0.0] * 12}}}
""",
    "opencv.yaml": f"""%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {K}
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: {D}
""",
    "kalibr.yaml": f"""cam0:
  camera_model: pinhole
  intrinsics: [600.5, 610.25, 320.0, 240.5]
  distortion_model: radtan
  distortion_coeffs: {D}
  resolution: [640, 480]
  rostopic: /left/image_raw
cam1:
  camera_model: pinhole
  intrinsics: [400.0, 400.0, 320.0, 240.0]
  distortion_model: equidistant
  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]
  resolution: [640, 480]
  rostopic: /right/image_raw
""",
    "photonvision.json": json.dumps(
        {
            "resolution": {"width": 640.0, "height": 480.0},
            "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": K},
            "distCoeffs": {"rows": 1, "cols": 5, "type": 6, "data": D},
        }
    ),
    "wpilib.json": json.dumps(
        {
            "image_width": 640,
            "image_height": 480,
            "camera_matrix": K,
            "distortion_coefficients": D,
            "avg_reprojection_error": 0.3,
        }
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_every_program_writes_the_same_camera(tmp_path, name):
    path = tmp_path / name
    path.write_text(FILES[name])
    assert read_camera(path, "cam0" if name == "kalibr.yaml" else None) == CAMERA


def test_of_several_the_one_of_the_topic_is_taken(tmp_path):
    path = tmp_path / "kalibr.yaml"
    path.write_text(FILES["kalibr.yaml"])
    assert read_camera(path, None, ["/left/image_raw"]) == CAMERA
    assert read_camera(path, None, ["/right/image_raw"]).model == "equidistant"
    with pytest.raises(InputError, match="several cameras, cam0, cam1; say which with calibration_name"):
        read_camera(path)
    with pytest.raises(InputError, match="no camera 'cam7'; this file has cam0, cam1"):
        read_camera(path, "cam7")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected names with values"),
        ("[1, 2, 3]", "expected names with values"),
        ("a: [1, 2", "neither YAML nor JSON"),
        ("{ no json", "neither YAML nor JSON"),
        ("nothing: 1", "no camera in it"),
        (FILES["ros.yaml"].replace("plumb_bob", "omni"), "unknown distortion model 'omni'"),
        (FILES["kalibr.yaml"].replace("pinhole", "ds"), "camera model 'ds' is not known"),
        (FILES["ros.yaml"].replace("600.5", "-3"), "above 0"),
        (FILES["ros.yaml"].replace(str(D), "[1, 2, 3, 4, 5, 6, 7]"), "found 7"),
        (FILES["ros.yaml"].replace(str(K), "[one, two]"), "expected numbers"),
    ],
)
def test_what_is_no_calibration_is_told_apart(tmp_path, text, words):
    path = tmp_path / "calibration.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        read_camera(path, "cam0" if "cam0" in text else None)
    assert str(path) in str(error.value)


def test_the_cameras_of_a_real_rig(data):
    folder = data("tagslam_dupont")
    left = read_camera(folder / "test_11" / "cameras.yaml", None, ["/fla/ovc_node/left/tags"])
    assert left == Camera((603.924, 603.166), (665.041, 554.34), "equidistant",
                          (-0.0122741, -0.0100319, 0.00752173, -0.00247881), (1280, 1024))  # fmt: skip
    ten = read_camera(folder / "test_10" / "cameras.yaml")
    assert ten.model == "radtan" and len(ten.distortion) == 5
    assert np.isclose(ten.distortion[4], -0.0286819)
