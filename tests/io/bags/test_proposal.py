"""The first team file that is proposed for a recording: which topics are one robot's."""

import tomllib

import numpy as np
import pytest

import recordings
from teamslam.io.bags import contents, proposal

CORNERS = [[10.0, 40.0], [40.0, 40.0], [40.0, 10.0], [10.0, 10.0]]


def proposed(folder, ways, cameras, height=lambda k: 0.0):
    """The robots of the team file for a recording with these topics, and its text."""
    messages = []
    for k in range(32):
        stamp = 10**18 + k * 100_000_000
        messages += [recordings.odometry(topic, stamp, (0.1 * k, 0.0, height(k))) for topic in ways]
        messages += [recordings.detections(topic, stamp, [(3, CORNERS)]) for topic in cameras]
    text = proposal(contents(recordings.write(folder, "mcap", messages)))
    return tomllib.loads(text)["robot"], text


def test_odometries_that_no_camera_goes_with_are_one_robots(tmp_path):
    """A drone with visual odometry and wheels' that has its cameras under other names."""
    (robot,), text = proposed(tmp_path, ["/vio/odometry", "/wheels/odom"], ["/down/tags", "/rear/tags"])
    assert robot["odometry"] == "/vio/odometry" and "# ? or /wheels/odom" in text
    assert [camera["tags"] for camera in robot["camera"]] == ["/down/tags", "/rear/tags"]


@pytest.mark.parametrize(
    ("height", "ground"), [(lambda k: 0.0, True), (lambda k: 0.2, True), (lambda k: 0.01 * k, False)]
)
def test_a_robot_on_the_ground_is_proposed_as_one(tmp_path, height, ground):
    """A line to make sure of, where the odometry never leaves the plane: whatever the plane's height."""
    (robot,), text = proposed(tmp_path, ["/odom"], ["/tags"], height)
    assert ("# dim = 2  # ?" in text) == ground
    assert "dim" not in robot


@pytest.mark.parametrize("topic", ["/mocap/pose", "/vicon/drone/odom", "/ground_truth", "/drone/gt"])
def test_motion_capture_is_truth_and_no_robot(tmp_path, topic):
    (robot,), _ = proposed(tmp_path, [topic, "/vio"], ["/down/tags"])
    assert robot["odometry"] == "/vio" and robot["truth"] == topic and len(robot["camera"]) == 1


def test_robots_by_their_names_have_the_truth_that_names_them(tmp_path):
    ways, cameras = ["/ann/odom", "/ben/odom", "/mocap/ben", "/mocap/ann"], ["/ann/tags", "/ben/tags", "/roof/tags"]
    robots, text = proposed(tmp_path, ways, cameras)
    assert [(robot["name"], robot["truth"]) for robot in robots] == [("ann", "/mocap/ann"), ("ben", "/mocap/ben")]
    assert [[camera["tags"] for camera in robot["camera"]] for robot in robots] == [["/ann/tags"], ["/ben/tags"]]
    assert "# /roof/tags: ?" in text


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (["/rig/left/detector/tags", "/rig/right/detector/tags"], ["left", "right"]),
        (["/detections", "/tags"], ["detections", "tags"]),
        (["/down/front/tags", "/up/front/tags", "/up/rear/tags"], ["down/front/tags", "up/front/tags", "up/rear/tags"]),
    ],
)
def test_cameras_have_names_of_their_own(tmp_path, topics, names):
    (robot,), _ = proposed(tmp_path, [], topics)
    assert [camera["name"] for camera in robot["camera"]] == names


@pytest.mark.parametrize(
    ("topics", "proposed_ones"),
    [
        (["/c/image_raw", "/c/image_rect_color", "/c/image_raw/compressed"], [("/c/image_raw", False)]),
        (["/c/image_rect", "/c/image_rect/compressed"], [("/c/image_rect", True)]),
        (["/c/left/image_rect", "/c/right/image_raw"], [("/c/left/image_rect", True), ("/c/right/image_raw", False)]),
    ],
)
def test_of_the_images_of_one_camera_one_is_proposed(tmp_path, topics, proposed_ones):
    """Raw ones before those that were made of them: the same tags seen twice would count twice."""
    grey, messages = np.zeros((8, 8), np.uint8), []
    for topic in topics:
        made = recordings.compressed(topic, 10**18, b"") if topic.endswith("compressed") else None
        messages.append(made or recordings.image(topic, 10**18, grey))
    for parent in {topic.split("/image")[0] for topic in topics}:
        messages.append(recordings.camera_info(f"{parent}/camera_info", 10**18, (9.0, 9.0), (4.0, 4.0), (8, 8)))
    (robot,) = tomllib.loads(proposal(contents(recordings.write(tmp_path, "mcap", messages))))["robot"]
    found = [(camera["images"], camera.get("rectified", False)) for camera in robot["camera"]]
    assert found == proposed_ones


@pytest.mark.parametrize(("late_s", "told"), [(3.0, 3.0), (-40.0, -40.0), (0.0, None)])
def test_clocks_of_robots_in_one_recording_are_told_by_when_messages_were_recorded(late_s, told, tmp_path):
    """All by one clock, 20 ms after they were made; less than half a second is left to runs."""
    messages = []
    for k in range(20):
        now = 10**18 + k * 100_000_000
        for name, late in (("ann", 0.0), ("ben", late_s)):
            stamp = now + round(late * 1e9)
            messages.append(
                recordings.odometry(f"/{name}/odom", stamp, (0.1 * k, 0.0, 0.0), received_ns=now + 20_000_000)
            )
            messages.append(recordings.detections(f"/{name}/tags", stamp, [(3, CORNERS)], now + 20_000_000))
    robots = tomllib.loads(proposal(contents(recordings.write(tmp_path, "mcap", messages))))["robot"]
    assert [robot.get("clock", {}).get("offset_s") for robot in robots] == [None, told]
