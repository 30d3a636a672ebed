"""One camera, as each program writes it, is one camera."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.frontend.tags.camera import Camera
from teamslam.io.bags.calibration import read_camera
from teamslam.io.bags.calibration_written import SAYS, kind_of, lenses_of, write_camera

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
    assert read_camera(path, None, ["/left/tags"]) == CAMERA  # a detector beside it
    with pytest.raises(InputError, match="say which with calibration_name"):
        read_camera(path, None, ["/up/tags"])
    with pytest.raises(InputError, match="several cameras, cam0, cam1; say which with calibration_name"):
        read_camera(path)
    with pytest.raises(InputError, match="no camera 'cam7'; this file has cam0, cam1"):
        read_camera(path, "cam7")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected names with values"),
        ("[1, 2, 3]", "expected names with values"),
        ("a: [1, 2", "neither YAML, JSON nor XML"),
        ("{ no json", "neither YAML, JSON nor XML"),
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


NAMES = ("camera.yaml", "camchain.yaml", "my_opencv.yml", "camera.xml", "camera.json", "photonvision.json")
NUMBER = st.floats(-5.0, 5.0, allow_nan=False) | st.sampled_from([0.0, 1e-17, -1e-5, 123456.789])
LENS = st.sampled_from([("radtan", 0), ("radtan", 4), ("radtan", 5), ("radtan", 8), ("equidistant", 4)])
CAMERAS = LENS.flatmap(
    lambda lens: st.builds(
        lambda f, c, k, size: Camera(f, c, lens[0], tuple(k), size),
        st.tuples(*[st.floats(1e-3, 1e5)] * 2),
        st.tuples(*[st.floats(-1e4, 1e4)] * 2),
        st.lists(NUMBER, min_size=lens[1], max_size=lens[1]),
        st.tuples(*[st.integers(1, 20000)] * 2),
    )
)


@pytest.mark.parametrize("name", NAMES)
@given(camera=CAMERAS)
def test_a_camera_written_is_read_again_to_the_bit(name, camera, tmp_path_factory):
    path = tmp_path_factory.mktemp("cameras") / name
    words = kind_of(path)[1]
    lens = camera.model, len(camera.distortion)
    if words in SAYS and lens not in SAYS[words] and camera.distortion:
        with pytest.raises(InputError, match=f"{words} knows cameras of"):
            write_camera(camera, path)
        assert not path.exists()
        return
    assert write_camera(camera, path) == words
    found = read_camera(path)
    padded = camera.distortion or found.distortion  # none at all is four zeros
    assert not any(found.distortion) if not camera.distortion else True
    assert found == Camera(camera.focal, camera.centre, camera.model, padded, camera.size)


@pytest.mark.parametrize("name", ["camera.xml", "my_opencv.yml"])
def test_opencv_reads_what_is_written_for_it(name, tmp_path):
    cv2 = pytest.importorskip("cv2")
    write_camera(CAMERA, tmp_path / name)
    stored = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
    assert stored.getNode("camera_matrix").mat().ravel().tolist() == K
    assert stored.getNode("distortion_coefficients").mat().ravel().tolist() == D
    assert stored.getNode("image_width").real() == 640.0


@pytest.mark.parametrize("name", ["camera.xml", "opencv.yaml"])
def test_what_opencv_writes_is_read(name, tmp_path):
    cv2 = pytest.importorskip("cv2")
    stored = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
    stored.write("image_width", 640)
    stored.write("image_height", 480)
    stored.write("camera_matrix", np.reshape(K, (3, 3)))
    stored.write("distortion_coefficients", np.reshape(D, (5, 1)))
    stored.release()
    assert read_camera(tmp_path / name) == CAMERA


def test_a_file_says_which_lenses_it_knows(tmp_path):
    assert lenses_of(tmp_path / "camchain.yaml") == (("radtan", 4), ("equidistant", 4))
    assert lenses_of(tmp_path / "a.yaml", "equidistant") == (("equidistant", 4),)
    with pytest.raises(InputError, match="WPILib knows no camera of equidistant"):
        lenses_of(tmp_path / "a.json", "equidistant")
    with pytest.raises(InputError, match="unknown model 'omni'"):
        lenses_of(tmp_path / "a.yaml", "omni")
    with pytest.raises(InputError, match="a camera is written as"):
        lenses_of(tmp_path / "a.txt")


def test_xml_with_declarations_is_refused(tmp_path):
    (tmp_path / "a.xml").write_text('<!DOCTYPE x [<!ENTITY a "b">]><x>&a;</x>')
    with pytest.raises(InputError, match="declarations are not read"):
        read_camera(tmp_path / "a.xml")
