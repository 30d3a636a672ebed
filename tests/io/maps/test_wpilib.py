"""A field layout of WPILib holds the tags, in the axes that its robots expect."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.io import MapEstimate, write_maps
from teamslam.model import Kind, Names, Values, landmark_key, landmark_number, pose_key


def estimate(poses, numbers, names=None):
    keys = np.append(landmark_key(np.array(numbers)), pose_key(1, 5))
    both = Pose(np.append(poses.rotation, np.eye(3)[None], 0), np.append(poses.translation, np.zeros((1, 3)), 0))
    values = Values.of({Kind.POSE3: (keys, both), Kind.POINT3: (landmark_key(np.array([99])), np.ones((1, 3)))})
    return MapEstimate(values, None, int(pose_key(1, 5)), names or Names())


def test_a_tag_that_looks_along_x_has_no_turn_there(tmp_path):
    """Who stands before it looks along -x, has y to the right, and z up: so are x and y of the tag for us."""
    facing = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], 1)
    places = np.array([[0.5, 2.0, 1.2], [16.0, 4.0, 0.3]])
    turned = Rotation.from_euler("z", 0.5 * np.pi).as_matrix() @ facing
    said = write_maps([estimate(Pose(np.stack([facing, turned]), places), [3, 7])], tmp_path / "field.json", "wpilib")
    (layout,) = [json.loads((tmp_path / "field.json").read_text())]
    one, other = layout["tags"]
    assert (one["ID"], other["ID"]) == (3, 7)
    assert one["pose"]["translation"] == {"x": 0.5, "y": 2.0, "z": 1.2}
    w, x, y, z = one["pose"]["rotation"]["quaternion"].values()
    np.testing.assert_allclose(np.abs([w, x, y, z]), [1, 0, 0, 0], atol=1e-12)
    w, x, y, z = other["pose"]["rotation"]["quaternion"].values()
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_euler("xyz"), [0, 0, 0.5 * np.pi], atol=1e-12)
    assert layout["field"] == {"length": 16.0, "width": 4.0}
    assert [d.count for d in said] == [2]  # the robot's pose, and a point


def test_landmarks_without_a_number_are_no_tags(tmp_path):
    box = landmark_number("box")
    found = estimate(Pose.identity(3, (1,)), [box], Names(landmarks={box: "box"}))
    with pytest.raises(InputError, match="no tags"):
        write_maps([found], tmp_path / "field.json")
