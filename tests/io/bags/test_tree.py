"""Frames that were broadcast: those that say how a robot moved stand in for odometry, those that stay for a camera's
place."""

import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import recordings
from teamslam.errors import InputError
from teamslam.io.bags import contents, opened, proposal, read_track
from teamslam.io.bags.tree import name_of, pair_named

START = 1_700_000_000 * 10**9
STEP = 2 * 10**7
CORNERS = [[10.0, 40.0], [40.0, 40.0], [40.0, 10.0], [10.0, 10.0]]


@pytest.fixture(params=recordings.KINDS)
def kind(request):
    return request.param


def driven(kind, topic="/tf", space="", odometry=()):
    """A wheel that turns, a map that drifts, a mast and a camera that leans on it, and where the base went."""
    type = "tf/msg/tfMessage" if kind == "bag" else "tf2_msgs/msg/TFMessage"

    def broadcast(topic, stamp, parent, child, place, angle=0.0, axis="z"):
        turn = Rotation.from_euler(axis, angle).as_quat()
        return recordings.transform(topic, stamp, space + parent, space + child, place, type, turn)

    messages = [
        broadcast("/tf_static", START, "base_link", "mast", (0.1, 0.0, 0.5), 0.3),
        broadcast("/tf_static", START, "mast", "optical", (0.0, 0.05, 0.1), -0.5 * np.pi, "x"),
        recordings.camera_info(f"/{space}cam/camera_info", START, (200.0,) * 2, (99.5,) * 2, (200, 200)),
    ]
    for k in range(60):
        stamp = START + k * STEP
        messages += [
            broadcast(topic, stamp, "odom", "base_link", (0.1 * k, 0.01 * k * k, 0.2), 0.05 * k),
            broadcast(topic, stamp, "base_link", "wheel", (0.0, 0.2, 0.0), 0.4 * k, "y"),
            broadcast(topic, stamp, "map", "odom", (0.001 * k, 0.0, 0.0)),
            recordings.detections(f"/{space}cam/tags", stamp, [(3, CORNERS)], frame=space + "optical"),
            *(recordings.odometry(name, stamp, (0.1 * k, 0.0, 0.0)) for name in odometry),
        ]
    return messages


def test_a_transform_is_read_as_odometry(tmp_path, kind):
    path = recordings.write(tmp_path, kind, driven(kind))
    (robot,) = tomllib.loads(proposal(contents(path)))["robot"]
    assert robot["odometry"] == "odom -> base_link"
    with opened(path) as recording:
        track = read_track(recording, robot["odometry"])
        with pytest.raises(InputError, match=r"no transform odom -> base; of those that move .* odom -> base_link"):
            read_track(recording, "odom -> base")
    k = np.arange(60)
    np.testing.assert_array_equal(track.ticks, (START + k * STEP) // 1000)
    np.testing.assert_allclose(track.poses.translation, np.stack([0.1 * k, 0.01 * k * k, 0.2 + 0.0 * k], -1))
    assert "# dim = 2" in proposal(contents(path))


def test_where_the_camera_is_stands_in_what_is_proposed(tmp_path, kind):
    """On the mast, by two transforms that stay: their product, written out."""
    (robot,) = tomllib.loads(proposal(contents(recordings.write(tmp_path, kind, driven(kind)))))["robot"]
    (camera,) = robot["camera"]
    mast, lean = Rotation.from_euler("z", 0.3), Rotation.from_euler("x", -0.5 * np.pi)
    np.testing.assert_allclose(camera["xyz_m"], mast.apply([0.0, 0.05, 0.1]) + np.array([0.1, 0.0, 0.5]), atol=1e-8)
    w, x, y, z = camera["quaternion_wxyz"]
    assert (Rotation.from_quat([x, y, z, w]).inv() * mast * lean).magnitude() < 1e-7


def test_a_way_without_a_frame_is_of_the_body_that_cameras_stand_in(tmp_path):
    """PoseStamped names no child."""
    messages = [message for message in driven("mcap") if message[0] != "/tf"]
    messages += [pose_stamped("/vio", START + k * STEP, (0.1 * k, 0.0, 0.0)) for k in range(60)]
    text = proposal(contents(recordings.write(tmp_path, "mcap", messages)))
    (robot,) = tomllib.loads(text)["robot"]
    assert robot["odometry"] == "/vio" and "# ? optical in base_link, by tf" in text
    np.testing.assert_allclose(robot["camera"][0]["xyz_m"][2], 0.6)


def pose_stamped(topic, stamp_ns, place):
    def make(store, header):
        types = store.types
        where = types["geometry_msgs/msg/Point"](*map(float, place))
        turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        pose = types["geometry_msgs/msg/Pose"](where, turn)
        return types["geometry_msgs/msg/PoseStamped"](header(stamp_ns, "odom"), pose)

    return topic, "geometry_msgs/msg/PoseStamped", stamp_ns, make


def test_beside_a_topic_of_odometry_no_transform_is_proposed(tmp_path):
    found = contents(recordings.write(tmp_path, "mcap", driven("mcap", odometry=["/wheels"])))
    (robot,) = tomllib.loads(proposal(found))["robot"]
    assert robot["odometry"] == "/wheels" and not any("->" in topic.name for topic in found.topics)


def test_a_transform_by_motion_capture_is_truth(tmp_path):
    messages = driven("mcap", odometry=["/wheels"])
    messages += driven("mcap", "/vicon_tf")[3:]
    robots = tomllib.loads(proposal(contents(recordings.write(tmp_path, "mcap", messages))))["robot"]
    assert len(robots) == 1 and robots[0]["odometry"] == "/wheels"


def test_robots_have_transforms_of_their_own(tmp_path):
    messages = driven("mcap", "/ann/tf", "ann/") + driven("mcap", "/ben/tf", "ben/")
    path = recordings.write(tmp_path, "mcap", sorted(messages, key=lambda message: message[2]))
    robots = tomllib.loads(proposal(contents(path)))["robot"]
    assert [(robot["name"], robot["odometry"]) for robot in robots] == [
        ("ann", "/ann/tf: ann/odom -> ann/base_link"), ("ben", "/ben/tf: ben/odom -> ben/base_link")
    ]  # fmt: skip
    assert all(len(robot["camera"]) == 1 and any(robot["camera"][0]["xyz_m"]) for robot in robots)


@pytest.mark.parametrize("topic", ["/tf", "/robot1/tf"])
def test_names_of_transforms_come_back(topic):
    assert pair_named(name_of(topic, ("odom", "base/link"))) == (topic, ("odom", "base/link"))
    assert pair_named("/robot1/odom") is None
