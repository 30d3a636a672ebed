"""Damaged recordings behind a team file: one clear error, or every image is either used or counted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import recordings
import teamslam as ts
from tag_pictures import picture, square
from teamslam.errors import InputError

pytest.importorskip("cv2")
START = 1_700_000_000 * 10**9
IMAGE = picture({3: square((50, 50), 60, 0.2), 8: square((120.5, 60.3), 50, -1.0)}, (170, 110), blur=0.5)
TEAM = """[tags]
size_m = 0.2
fewest = 1
[[robot]]
name = "one"
recording = "{recording}"
image_every_s = 0.0
{odometry}
[[robot.camera]]
name = "front"
images = "/raw"
calibration = "{calibration}"
"""
CAMERA = (
    '{"camera_matrix": [200, 0, 85, 0, 200, 55, 0, 0, 1], "distortion_coefficients": [0, 0, 0, 0, 0], '
    '"image_width": 170, "image_height": 110}'
)


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def short(message):
    """An image whose bytes are too few for the size that it states."""
    topic, type_, received, make = message

    def less(store, header):
        found = make(store, header)
        found.data = found.data[:100]
        return found

    return topic, type_, received, less


KINDS = {
    "good": lambda at: recordings.image("/raw", at, IMAGE),
    "encoding": lambda at: recordings.image("/raw", at, IMAGE, "mono7"),
    "short": lambda at: short(recordings.image("/raw", at, IMAGE)),
    "size": lambda at: recordings.image("/raw", at, IMAGE[:60, :60]),
}
JUMPS_NS = st.sampled_from([10**8, 10**8, 10**8, 0, -(10**9), 10**10, -(10**18), 10**18])


def team(folder, messages, odometry="", calibration="camera.json", kind="mcap"):
    path = recordings.write(folder, kind, messages)
    (folder / "camera.json").write_text(CAMERA)
    text = TEAM.format(recording=path.relative_to(folder), odometry=odometry, calibration=calibration)
    (folder / "team.toml").write_text(text)
    return folder / "team.toml"


@settings(max_examples=15, deadline=None)
@given(
    images=st.lists(st.tuples(st.sampled_from(list(KINDS)), JUMPS_NS), min_size=1, max_size=6),
    kind=st.sampled_from(["mcap", "bag"]),
)
def test_every_image_is_used_or_counted(images, kind, tmp_path_factory):
    messages, at = [], START
    for name, jump in images:
        at = int(np.clip(at + jump, 1, 2**31 * 10**9 - 1))  # what a stamp of ROS can say
        messages.append(KINDS[name](at))
    folder = tmp_path_factory.mktemp("damaged")
    try:
        log = ts.read(team(folder, messages, kind=kind))
    except InputError as error:
        assert not any(name == "good" for name, _ in images) or "calibration is for" in str(error)
        assert "tag" in str(error) or "calibration" in str(error)
    else:
        lost = sum(d.count for d in log.dropped if "images" in d.reason)
        assert lost == sum(name != "good" for name, _ in images)


def test_no_camera_info_is_said(tmp_path):
    path = team(tmp_path, [KINDS["good"](START)], calibration="/camera/camera_info")
    with pytest.raises(
        InputError, match="there is no topic /camera/camera_info; of camera_info this recording has none"
    ):
        ts.read(path)


@pytest.mark.parametrize("kind", recordings.KINDS)
def test_types_that_nobody_knows_do_no_harm(kind, tmp_path):
    messages = [KINDS["good"](START + k * 10**8) for k in range(3)]
    type_ = "tf/msg/tfMessage" if kind == "bag" else "tf2_msgs/msg/TFMessage"
    messages.insert(1, recordings.transform("/tf", START, "a", "b", (0, 0, 0), type_))
    log = ts.read(team(tmp_path, messages, kind=kind))
    assert not log.dropped and len(log.pose_keys[1]) == 3
    with pytest.raises(InputError, match=f"/tf holds {type_}; expected one of nav_msgs"):
        ts.read(team_of(tmp_path, 'odometry = "/tf"'))


def team_of(folder, odometry):
    text = (folder / "team.toml").read_text()
    (folder / "team.toml").write_text(text.replace("image_every_s = 0.0\n", f"image_every_s = 0.0\n{odometry}\n"))
    return folder / "team.toml"


@pytest.mark.parametrize("jump_ns", [-(10**9), 10**10, -(10**17), 10**17])
def test_odometry_whose_stamps_jump(jump_ns, tmp_path):
    messages = []
    for k in range(12):
        at = START + k * 10**8
        messages.append(recordings.odometry("/odom", at + (jump_ns if k == 5 else 0), (0.05 * k, 0, 0), received_ns=at))
        messages.append(recordings.image("/raw", at, IMAGE, received_ns=at))
    log = ts.read(team(tmp_path, messages, 'odometry = "/odom"'))
    (steps,) = [t for t in log.tables if t.source == "odometry"]
    assert len(log.pose_keys[1]) == 12 and len(steps) == 11
    assert np.isfinite(steps.values).all() and np.isfinite(steps.whitening).all()
    assert np.abs(steps.values[:, :3]).max() < 0.2  # the jump is no step


def test_a_topic_of_odometry_without_a_message(tmp_path):
    """Its connection stands in the file, and nothing came."""
    far = recordings.odometry("/odom", START, (np.nan, 0, 0))
    try:
        log = ts.read(
            team(tmp_path, [far, *(KINDS["good"](START + k * 10**8) for k in range(3))], 'odometry = "/odom"')
        )
    except InputError as error:
        assert "odom" in str(error)
    else:
        assert any("odometry is missing" in note for note in log.notes)
        assert sum(d.count for d in log.dropped) == 1
