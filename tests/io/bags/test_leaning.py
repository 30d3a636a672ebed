"""A camera that is turned in its robot otherwise than the team file says is told, and how it is; others are not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import recordings
import tagged_room
import teamslam as ts
from tagged_room import CAMERA, START, UPRIGHT

STATED = "quaternion_wxyz = [0.5, -0.5, 0.5, -0.5]"
SIZE = 0.2


def said(path):
    return [note for note in ts.read(path).notes if "turned about axes" in note]


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        (None, None),
        ("z", None),  # about the vertical: on the ground nobody can tell
        ("x", None),  # leans by 10 degrees
        ([1.0, 0.0, 0.0, 0.0], "up from the ground, and is said to look 90"),
        ([0.0, 1.0, 0.0, 0.0], "up from the ground, and is said to look -90"),
    ],
)
def test_on_the_ground_it_is_told_how_a_camera_leans(turned, words, tmp_path):
    team = tagged_room.write(tagged_room.make(seconds=24.0, rate=4.0), tmp_path)
    if turned is not None:
        if isinstance(turned, str):
            turn = Rotation.from_euler(turned, 10.0 if turned == "x" else 40.0, degrees=True)
            turned = (turn * Rotation.from_matrix(UPRIGHT)).as_quat()[[3, 0, 1, 2]].tolist()
        team.write_text(team.read_text().replace(STATED, f"quaternion_wxyz = {turned}"))
    found = said(team)
    if words is None:
        assert not found
    else:
        assert len(found) == 2 and all(note.endswith(words) for note in found)
        assert all(abs(float(note.split("it looks ")[1].split()[0])) < 5.0 for note in found)


def flown(folder, stated, rate=6, seconds=20):
    """A drone that rolls, pitches and yaws before a wall of tags; its camera is as `UPRIGHT`, turned by 0.4 rad."""
    rng, eye = np.random.default_rng(0), UPRIGHT @ Rotation.from_euler("y", 0.4).as_matrix()
    wall = {n: np.array([3.0, 0.8 * (n % 4) - 1.2, 0.8 * (n // 4) - 0.4]) for n in range(8)}
    facing = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    square = 0.5 * SIZE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    messages = [recordings.camera_info("/info", START, CAMERA.focal, CAMERA.centre, CAMERA.size, CAMERA.distortion)]
    for k in range(rate * seconds):
        t, stamp = k / rate, START + round(1e9 * k / rate)
        angles = 0.4 * np.array([1.2 * np.sin(1.1 * t) + 1.0, np.sin(0.9 * t), np.sin(1.3 * t + 1.0)])
        body, place = Rotation.from_euler("ZYX", angles), np.array([0.2 * np.sin(t), 0.3 * np.cos(0.7 * t), 0.0])
        messages.append(recordings.odometry("/odom", stamp, place, body.as_quat()))
        R, found = body.as_matrix() @ eye, []
        for n, middle in wall.items():
            corners = (square @ facing.T + middle - place) @ R
            pixels = CAMERA.project(corners)
            if corners[:, 2].min() > 0.2 and (pixels > 2).all() and (pixels < np.array(CAMERA.size) - 3).all():
                found.append((n, pixels + 0.5 + 0.1 * rng.normal(size=(4, 2))))
        messages.append(recordings.detections("/tags", stamp, found))
    recordings.write(folder, "mcap", messages)
    quaternion = Rotation.from_matrix(eye if stated is None else stated).as_quat()[[3, 0, 1, 2]].tolist()
    (folder / "team.toml").write_text(
        f'[tags]\nsize_m = {SIZE}\n[[robot]]\nname = "one"\nrecording = "recording"\nodometry = "/odom"\n'
        f'[[robot.camera]]\nname = "eye"\ntags = "/tags"\ncalibration = "/info"\nquaternion_wxyz = {quaternion}\n'
    )
    return folder / "team.toml", Rotation.from_matrix(eye)


@pytest.mark.parametrize("stated", [None, np.eye(3), UPRIGHT @ np.diag([-1.0, -1.0, 1.0])])
def test_in_space_it_is_told_how_a_camera_is_turned(stated, tmp_path):
    team, eye = flown(tmp_path, stated)
    found = said(team)
    if stated is None:
        assert not found
        return
    (note,) = found
    w, x, y, z = map(float, note.split("[")[1].split("]")[0].split(","))
    assert (Rotation.from_quat([x, y, z, w]).inv() * eye).magnitude() < np.radians(3.0)
