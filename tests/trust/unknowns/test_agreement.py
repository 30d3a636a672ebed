"""What is carried about makes a camera seem late: a latency on which landmarks contradict each other is not claimed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import recordings
import tagged_room
import teamslam as ts
from tagged_room import CAMERA, EDGE, FLOOR, HEIGHT, START, UPRIGHT
from teamslam.frontend.tags.noise import corner_covariances
from teamslam.solver.optimise import DEFAULTS
from teamslam.trust.unknowns import sentences_of, settled

LATE_S = 0.1
CARRIED = (0, 1, 2, 3, 4)  # tags that somebody carries to and fro as the robot turns, by what it turns in LATE_S
SIZE = 0.14


def seen(rng, eye, tags):
    """What a detector says of one image."""
    R, T = eye
    found = []
    for number, (Rt, Tt) in tags.items():
        corners = ((0.5 * SIZE * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])) @ Rt.T + Tt - T) @ R
        if corners[:, 2].min() < 0.2 or Rt[:, 2] @ (T - Tt) < 0.25 * np.linalg.norm(T - Tt):
            continue
        pixels = CAMERA.project(corners)
        if not ((pixels > 2).all() and (pixels < np.array(CAMERA.size) - 3).all()):
            continue
        root = np.linalg.cholesky(corner_covariances(pixels[None], FLOOR, EDGE)[0])
        found.append((number, pixels + (root @ rng.normal(size=8)).reshape(4, 2) + 0.5))
    return found


def way(t):
    a = 2.0 * np.pi * t / 25.0
    return np.array([0.8 * np.cos(a), 0.7 * np.sin(a), a + 0.5 * np.pi + 1.3 * np.sin(3.0 * a)])


def walked(folder, carried=(), late_s=0.0, seconds=24.0):
    """The log of a robot that drives round in a room, looking to and fro, and whose images are stamped late."""
    rng, messages, slipped = np.random.default_rng(3), [], np.zeros(3)
    walls = tagged_room.wall_tags(rng)
    for k in range(round(20 * seconds)):
        t = 0.05 * k
        slipped = slipped + 0.004 * rng.normal(size=3)
        x, y, heading = way(t) + slipped
        stamp = START + round(1e9 * t)
        messages.append(recordings.odometry("/odom", stamp, (x, y, 0.0), Rotation.from_euler("z", heading).as_quat()))
        if k % 5 == 0:
            still = {number: wall for number, wall in walls.items() if number not in carried}
            shown = seen(rng, tagged_room.camera_of(way(t)), still)
            shown += seen(rng, tagged_room.camera_of(way(t - LATE_S)), {number: walls[number] for number in carried})
            messages.append(recordings.detections("/tags", stamp + round(1e9 * late_s), shown, stamp + 1000))
    messages.append(recordings.camera_info("/info", START, CAMERA.focal, CAMERA.centre, CAMERA.size, CAMERA.distortion))
    path = recordings.write(folder, "mcap", sorted(messages, key=lambda message: message[2]))
    (folder / "team.toml").write_text(
        f'[tags]\nsize_m = {SIZE}\n[[robot]]\nname = "one"\nrecording = "{path.name}"\nodometry = "/odom"\ndim = 2\n'
        f'[[robot.camera]]\nname = "eye"\ntags = "/tags"\ncalibration = "/info"\nxyz_m = [0.0, 0.0, {HEIGHT}]\n'
        f"quaternion_wxyz = {Rotation.from_matrix(UPRIGHT).as_quat()[[3, 0, 1, 2]].tolist()}\n"
        f"floor_px = {FLOOR}\nedge_px = {EDGE}\n"
    )
    return ts.read(folder / "team.toml")


def test_tags_that_are_carried_about_make_no_camera_late(tmp_path):
    """They turn as if they were seen late; all others say that nothing is."""
    found = settled(walked(tmp_path, CARRIED), DEFAULTS)
    (late,) = found.found
    assert late.value == 0.0 and not late.told and late.feigned > 5.0 * late.sigma
    assert any("landmarks contradict each other" in sentence for sentence in sentences_of(found))


@pytest.mark.parametrize("late_s", [0.0, LATE_S])
def test_where_all_tags_stand_a_latency_is_what_it_is(late_s, tmp_path):
    """All landmarks agree on it."""
    (late,) = settled(walked(tmp_path, late_s=late_s), DEFAULTS).found
    assert late.feigned is None and late.told == (late_s > 0.0)
    assert abs(late.value - late_s) < 4.0 * late.sigma
