"""Detections that are poses only count as the corners that these imply: with their noise, and for both poses of two."""

import numpy as np
import pytest

import recordings
import tagged_room
import teamslam as ts
from teamslam.frontend.tags.implied import TagPoses, implied_corners
from teamslam.geometry import Pose
from teamslam.geometry.resection import resect
from teamslam.io.bags import opened, read_corners
from teamslam.io.bags.streams import read_tag_poses

TYPES = ("apriltag_ros/msg/AprilTagDetectionArray", "vision_msgs/msg/Detection3DArray")
INTO = np.diag([1.0, -1.0, -1.0])  # a detector's tag whose z looks into it
SQUARE = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


def poses(count, seed):
    """Tags that a camera sees from their fronts."""
    rng = np.random.default_rng(seed)
    turns = Pose.from_tangent(np.concatenate([np.zeros((count, 3)), rng.uniform(-0.9, 0.9, (count, 3))], -1), 3)
    places = rng.uniform(-0.3, 0.3, (count, 3)) * [1, 1, 0] + np.stack(
        [np.zeros(count)] * 2 + [rng.uniform(0.5, 4, count)], -1
    )
    return Pose(INTO @ turns.rotation, places)


@pytest.mark.parametrize("outwards", [True, False])
def test_the_corners_of_a_pose_give_the_pose(outwards):
    true, camera = poses(40, 0), tagged_room.CAMERA
    told = true if outwards else Pose(true.rotation @ INTO, true.translation)
    every = np.arange(40)
    seen, lost = implied_corners(TagPoses(every, every, every, told, np.full(40, np.nan)), camera, np.full(40, 0.2))
    assert not lost.any()
    rays, good = camera.rays(seen.corners)
    two = resect(rays, np.tile(0.2 * SQUARE, (40, 1, 1)), np.eye(8)[None]).poses
    near = np.minimum(*(np.linalg.norm(two[:, k].minus(true), axis=-1) for k in (0, 1)))
    assert good.all() and near.max() < 1e-4


def test_a_tag_behind_the_camera_is_left_out():
    true = Pose(INTO[None], np.array([[0.0, 0.0, -1.0]]))
    one = np.zeros(1, np.int64)
    seen, lost = implied_corners(TagPoses(one, one, one, true, np.full(1, np.nan)), tagged_room.CAMERA, np.full(1, 0.2))
    assert lost.all() and not len(seen)


@pytest.mark.parametrize("type_", TYPES)
@pytest.mark.parametrize("kind", recordings.KINDS)
def test_poses_are_read_by_every_type(type_, kind, tmp_path):
    true = poses(3, 1)
    tags = [(k, true.rotation[k], true.translation[k], 0.16) for k in range(3)]
    more = [((4, 5), np.eye(3), [0, 0, 1.0], 0.1)] if "ros" in type_ else []
    far = [(9, np.eye(3), [0, 0, np.nan], 0.1)]
    path = recordings.write(tmp_path, kind, [recordings.tag_poses("/tags", 10**9, [*tags, *more, *far], type_)])
    with opened(path) as recording:
        found = read_tag_poses(recording, "/tags")
        assert sum(d.count for d in recording.dropped) == 1 + len(more)
    assert found.ids.tolist() == [0, 1, 2] and found.sizes_m.tolist() == [0.16] * 3
    assert np.allclose(found.poses.translation, true.translation) and np.allclose(found.poses.rotation, true.rotation)


def as_poses(folder, size_m):
    """The recordings of a room with their corners made poses, as detectors do: by OpenCV, one of two where two fit."""
    cv2 = pytest.importorskip("cv2")
    camera = tagged_room.CAMERA
    for robot in (0, 1):
        with opened(folder / f"robot{robot}" / "recording") as recording:
            seen = read_corners(recording, "/camera/tags")
            way = [recording.decode(m) for m in recording.messages(["/odom"])]
            ticks = [m.tick for m in recording.messages(["/odom"])]
        messages = []
        for found, tick in zip(way, ticks, strict=True):
            p, q = found.pose.pose.position, found.pose.pose.orientation
            messages.append(recordings.odometry("/odom", tick * 1000, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)))
        K = np.array([[camera.focal[0], 0, camera.centre[0]], [0, camera.focal[1], camera.centre[1]], [0, 0, 1.0]])
        for k, tick in enumerate(seen.frames.tolist()):
            tags = []
            for row in np.flatnonzero(seen.frame == k).tolist():
                upper = seen.corners[row][[3, 2, 1, 0]].astype(np.float64)
                _, turns, places, _ = cv2.solvePnPGeneric(
                    size_m * SQUARE[[3, 2, 1, 0]], upper, K, np.array(camera.distortion), flags=cv2.SOLVEPNP_IPPE_SQUARE
                )
                tags.append((int(seen.ids[row]), cv2.Rodrigues(turns[0])[0], places[0].ravel(), size_m))
            messages.append(recordings.tag_poses("/camera/tags", tick * 1000, tags, TYPES[0]))
        (folder / f"again{robot}").mkdir()
        recordings.write(folder / f"again{robot}", "mcap", sorted(messages, key=lambda m: m[2]))
    text = (folder / "team.toml").read_text().replace("robot0/rec", "again0/rec").replace("robot1/rec", "again1/rec")
    (folder / "poses.toml").write_text(text)
    return folder / "poses.toml"


@pytest.mark.parametrize("told", [1.0, 0.8])
def test_a_room_by_poses_is_the_room_by_corners(told, tmp_path):
    room = tagged_room.make(seed=2, seconds=12.0, rate=2.0)
    by_corners = ts.run(tagged_room.write(room, tmp_path, noise=0.5))  # with more, one pose of two may be the wrong one
    by_poses = ts.run(as_poses(tmp_path, told * tagged_room.SIZE))
    size = [note for note in ts.read(tmp_path / "poses.toml").notes if "the detector took tag" in note]
    assert bool(size) == (told != 1.0) and all(note.count("the detector took tags") == 1 for note in size)
    walls = [str(key) for key in by_poses.dataset.landmark_keys.tolist()]
    assert len(walls) >= 6
    for number in walls:
        one, other = (found.landmark(number) for found in (by_corners, by_poses))
        assert np.linalg.norm(np.subtract(one.position, other.position)) < 0.03
