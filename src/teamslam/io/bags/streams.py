"""The messages of one topic as arrays: odometry and poses, transforms, corners of tags.

Messages that say nothing usable (numbers that are not finite, a quaternion of length zero, a tag with no four corners)
are counted as dropped by the recording.
"""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.streams import TagCorners, Track
from teamslam.frontend.tags.implied import TagPoses
from teamslam.geometry import Array
from teamslam.io.bags.opened import Message, Recording
from teamslam.io.bags.poses import is_pose, poses_of, seven_of
from teamslam.io.bags.roles import ROLES
from teamslam.io.bags.tree import Broadcast, Pair, moves, name_of, pair_named

HALF_PIXEL = {"apriltag_msgs/msg/AprilTagDetectionArray", "isaac_ros_apriltag_interfaces/msg/AprilTagDetectionArray"}
"""Types whose pixels have their centres at halves, as the AprilTag library counts them."""

FARTHEST_PIXEL = 1e6
FARTHEST_TAG_M = 1e3
LEAST_PX2 = 1.0  # that a tag's corners enclose


def read_track(recording: Recording, topic: str) -> Track:
    """Odometry or poses of one topic, or of one transform (`odom -> base_link`), in the order in which they were
    recorded. InputError where the topic holds something else, or nothing."""
    if (named := pair_named(topic)) is not None:
        return _transform(recording, *named)
    ticks, numbers, noises = [], [], []
    parent = child = ""
    for message, found in _decoded(recording, topic, ("odometry", "pose")):
        parent = parent or found.header.frame_id
        child = child or getattr(found, "child_frame_id", "")
        seven, noise = _pose_of(found)
        if not is_pose(seven):
            recording.lose(1, f"of {topic}: their position is no place, or their quaternion no rotation")
            continue
        ticks.append(message.tick)
        numbers.append(seven)
        noises.append(noise)
    known = [noise for noise in noises if noise is not None]
    return Track(
        np.array(ticks, np.int64),
        poses_of(numbers),
        parent,
        child,
        np.stack(known).reshape(-1, 6, 6) if known and len(known) == len(noises) else None,
    )


def read_transforms(recording: Recording, topics: tuple[str, ...] = ("/tf", "/tf_static")) -> list[Track]:
    """Every transform that was broadcast, a track for each pair of frames."""
    heard = Broadcast()
    for topic in topics:
        if topic in recording.topics:
            for message, found in _decoded(recording, topic, ("transforms",)):
                _hear(recording, heard, message, found)
    return list(heard.tracks().values())


def hear(recording: Recording, heard: Broadcast, message: Message) -> None:
    """Take in a message of transforms; those that are none are counted as dropped."""
    if (found := recording.decode(message)) is not None:
        _hear(recording, heard, message, found)


def _hear(recording: Recording, heard: Broadcast, message: Message, found: Any) -> None:
    if wrong := heard.hear(found, message.tick):
        recording.lose(wrong, f"of {message.topic}: a transform's position is no place, or its quaternion no rotation")


def _transform(recording: Recording, topic: str, pair: Pair) -> Track:
    """One transform as a track. InputError where it was not broadcast."""
    tracks = {(track.parent, track.child): track for track in read_transforms(recording, (topic,))}
    if pair not in tracks:
        listing = ", ".join(name_of(topic, other) for other, track in tracks.items() if moves(track)) or "none"
        raise InputError(
            f"there is no transform {name_of(topic, pair)}; of those that move this recording has {listing}",
            path=recording.path,
        )
    return tracks[pair]


def read_corners(recording: Recording, topic: str) -> TagCorners:
    """The corners of tags that a detector found. InputError where the topic holds something else, or nothing."""
    frames: list[int] = []
    frame, ids, corners, hamming, families = [], [], [], [], []
    for message, found in _decoded(recording, topic, ("tags",)):
        shift = 0.5 if message.type in HALF_PIXEL else 0.0
        for tag in found.detections if hasattr(found, "detections") else found.apriltags:
            square = np.array([(corner.x, corner.y) for corner in tag.corners], float)
            if square.shape != (4, 2) or not (np.abs(square) < FARTHEST_PIXEL).all():
                recording.lose(1, f"of {topic}: a tag whose corners are not four points of an image")
                continue
            if np.abs(enclosed(square)) < LEAST_PX2:
                recording.lose(1, f"of {topic}: a tag whose corners enclose nothing")
                continue
            if tag.id < 0:
                recording.lose(1, f"of {topic}: a tag with a number below 0")
                continue
            frame.append(len(frames))
            ids.append(int(tag.id))
            corners.append(square - shift)
            hamming.append(int(getattr(tag, "hamming", 0)))
            families.append(str(tag.family))
        frames.append(message.tick)
    return TagCorners(
        np.array(frames, np.int64),
        np.array(frame, np.int64),
        np.array(ids, np.int64),
        np.array(corners, float).reshape(-1, 4, 2),
        np.array(hamming, np.int64),
        tuple(families),
    )


def enclosed(corners: Array) -> Array:
    """The area of quadrilaterals (..., 4, 2) [pixels^2]: above 0 where their corners go round as those of the AprilTag
    library do, from the bottom left by the bottom right."""
    one, other = corners[..., 2, :] - corners[..., 0, :], corners[..., 3, :] - corners[..., 1, :]
    return np.asarray(0.5 * (one[..., 1] * other[..., 0] - one[..., 0] * other[..., 1]))


def read_tag_poses(recording: Recording, topic: str) -> TagPoses:
    """The poses of tags that a detector found. Bundles of several tags, and what has no number, are counted as dropped.
    InputError where the topic holds something else."""
    frames: list[int] = []
    frame, ids, numbers, sizes = [], [], [], []
    for message, found in _decoded(recording, topic, ("tag poses",)):
        for tag in found.detections:
            number, seven, size = _posed(tag)
            if number is None:
                recording.lose(1, f"of {topic}: a bundle of several tags, or one without a number")
            elif not is_pose(seven) or not 1e-3 < np.linalg.norm(seven[:3]) < FARTHEST_TAG_M:
                recording.lose(1, f"of {topic}: a tag whose pose is none that a camera can see")
            else:
                frame.append(len(frames))
                ids.append(number)
                numbers.append(seven)
                sizes.append(size if 0.0 < size < FARTHEST_TAG_M else np.nan)
        frames.append(message.tick)
    return TagPoses(
        np.array(frames, np.int64),
        np.array(frame, np.int64),
        np.array(ids, np.int64),
        poses_of(numbers),
        np.array(sizes, float),
    )


def _posed(tag: Any) -> tuple[int | None, list[float], float]:
    """Number, pose and edge of a tag, by apriltag_ros or as a detection of vision_msgs, whose class or name is the
    number, alone or at the end ('tag36h11:7')."""
    if hasattr(tag, "results"):
        names = [str(tag.id), *(str(result.hypothesis.class_id) for result in tag.results[:1])]
        digits = next((m[0] for m in (re.search(r"\d+$", name) for name in names) if m), None)
        pose = tag.results[0].pose.pose if len(tag.results) else tag.bbox.center
        number, size = None if digits is None or len(digits) > 9 else int(digits), float(tag.bbox.size.x)
    else:
        pose = tag.pose.pose.pose
        one = len(tag.id) == len(tag.size) == 1 and tag.id[0] >= 0
        number, size = (int(tag.id[0]), float(tag.size[0])) if one else (None, 0.0)
    return number, seven_of(pose.position, pose.orientation), size


def _decoded(recording: Recording, topic: str, roles: tuple[str, ...]) -> Iterator[tuple[Message, Any]]:
    """The messages of a topic that is for one of some things, decoded."""
    if topic not in recording.topics:
        listing = ", ".join(sorted(recording.topics)) or "none"
        raise InputError(f"there is no topic {topic}; this recording has {listing}", path=recording.path)
    types, _ = recording.topics[topic]
    for type in types:
        if ROLES.get(type) not in roles:
            wanted = ", ".join(name for name, role in ROLES.items() if role in roles)
            raise InputError(f"{topic} holds {type}; expected one of {wanted}", path=recording.path)
    here, left = -1, set[int]()
    for message in recording.messages([topic]):
        if message.part != here:
            left.add(here)
            here = message.part
            if here in left and "transforms" not in roles:
                raise InputError(
                    f"two of its parts hold {topic} at the same time: they are recordings of two robots, each of which "
                    f"has its own [[robot]], or of one robot twice",
                    path=recording.path,
                    field="robot.recording",
                )
        if (found := recording.decode(message)) is not None:
            yield message, found


def _pose_of(found: Any) -> tuple[list[float], Array | None]:
    """Position and quaternion (x, y, z, w) of a message with a pose, and its covariance where it has one."""
    if hasattr(found, "transform"):
        return seven_of(found.transform.translation, found.transform.rotation), None
    pose, noise = found.pose, None
    if hasattr(pose, "covariance"):
        pose, noise = pose.pose, np.asarray(pose.covariance, float)
    return seven_of(pose.position, pose.orientation), noise
