"""Recordings written: streams as the messages that robots record, ROS 2 (MCAP) or ROS 1 (`.bag`).

A stream yields messages in the order of their stamps; those of all streams are recorded in the order of theirs. A
recording is there whole or not at all.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import AnyArray, Pose
from teamslam.io.files.whole import beside

KINDS = {"mcap": "", "bag": ".bag"}
"""What is written, by name, and the ending of its path: a folder for ROS 2."""


@dataclass(frozen=True, eq=False)
class Written:
    """A message to be written: when, on which topic, its type, and what makes it of the types of a kind of ROS."""

    tick: int
    topic: str
    type: str
    make: Callable[["_Words"], Any]


def odometry_messages(topic: str, track: Track) -> Iterator[Written]:
    """A track as nav_msgs/Odometry; its covariances, where it has none, are zero, as ROS says 'unknown'."""
    for k, tick in enumerate(track.ticks.tolist()):
        yield Written(
            tick, topic, "nav_msgs/msg/Odometry",
            lambda words, k=k, tick=tick: words.odometry(tick, track, k),  # type: ignore[misc]
        )  # fmt: skip


def pose_messages(topic: str, track: Track) -> Iterator[Written]:
    """A track as geometry_msgs/PoseStamped, as motion capture gives it."""
    for k, tick in enumerate(track.ticks.tolist()):
        yield Written(
            tick, topic, "geometry_msgs/msg/PoseStamped",
            lambda words, k=k, tick=tick: words.pose_stamped(tick, track, k),  # type: ignore[misc]
        )  # fmt: skip


def image_messages(space: str, images: Iterable[tuple[int, AnyArray]], camera: Camera, frame: str) -> Iterator[Written]:
    """Grey images (tick, (h, w) of bytes) as sensor_msgs/Image on `space`/image_raw, each with its camera on
    `space`/camera_info."""
    for tick, image in images:
        yield Written(
            tick, f"{space}/image_raw", "sensor_msgs/msg/Image",
            lambda words, tick=tick, image=image: words.image(tick, image, frame),  # type: ignore[misc]
        )  # fmt: skip
        yield Written(
            tick, f"{space}/camera_info", "sensor_msgs/msg/CameraInfo",
            lambda words, tick=tick: words.camera_info(tick, camera, frame),  # type: ignore[misc]
        )  # fmt: skip


def depth_messages(topic: str, depths: Iterable[tuple[int, AnyArray]], frame: str) -> Iterator[Written]:
    """Depths (tick, (h, w) of 16 bits) [mm] as sensor_msgs/Image."""
    for tick, depth in depths:
        yield Written(
            tick, topic, "sensor_msgs/msg/Image",
            lambda words, tick=tick, depth=depth: words.image(tick, depth, frame),  # type: ignore[misc]
        )  # fmt: skip


def write_recording(path: Path, kind: str, streams: Iterable[Iterator[Written]]) -> None:
    """A recording of a kind of KINDS at a path that is not there yet. InputError where it is; MissingExtraError without
    `rosbags`."""
    try:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError("writing recordings needs rosbags: pip install 'teamslam[bags]'") from None
    if kind not in KINDS:
        raise InputError(f"recordings are written as {' or '.join(KINDS)}, found '{kind}'", field="to")
    if path.exists():
        raise InputError("there is something already; choose another name", path=path)
    first = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    words, room = _Words(store.types, first), beside(path)
    room.mkdir()
    draft = room / path.name  # by its final name, which is that of the files in it, too
    writer = Writer1(draft) if first else Writer2(draft, version=9, storage_plugin=StoragePlugin.MCAP)
    try:
        with writer as bag:
            connections: dict[str, Any] = {}
            for one in merge(*streams, key=lambda message: message.tick):
                if one.topic not in connections:
                    connections[one.topic] = bag.add_connection(one.topic, one.type, typestore=store)
                serialize = store.serialize_ros1 if first else store.serialize_cdr
                bag.write(connections[one.topic], one.tick * 1000, serialize(one.make(words), one.type))
        draft.rename(path)
    finally:
        rmtree(room)


class _Words:
    """Messages in the words of one kind of ROS: the first numbers its headers, and shouts the names of a camera."""

    def __init__(self, types: Any, first: bool) -> None:
        self._types, self._first = types, first

    def odometry(self, tick: int, track: Track, k: int) -> Any:
        """One message of odometry."""
        zero = self._make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self._make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        noise = np.zeros(36) if track.covariances is None else track.covariances[k].ravel()
        return self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(tick, track.parent),
            child_frame_id=track.child,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=self._pose(track.poses[k]), covariance=noise),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )

    def pose_stamped(self, tick: int, track: Track, k: int) -> Any:
        """One pose."""
        header = self._header(tick, track.parent)
        return self._make("geometry_msgs/msg/PoseStamped", header=header, pose=self._pose(track.poses[k]))

    def image(self, tick: int, image: AnyArray, frame: str) -> Any:
        """One image, grey of bytes or depth of 16 bits."""
        (height, width), deep = image.shape, image.dtype == np.uint16
        return self._make(
            "sensor_msgs/msg/Image",
            header=self._header(tick, frame),
            height=height,
            width=width,
            encoding="16UC1" if deep else "mono8",
            is_bigendian=0,
            step=width * (1 + deep),
            data=np.ascontiguousarray(image, "<u2" if deep else np.uint8).view(np.uint8).ravel(),
        )

    def camera_info(self, tick: int, camera: Camera, frame: str) -> Any:
        """The camera of an image."""
        (fx, fy), (cx, cy) = camera.focal, camera.centre
        model = "equidistant" if camera.model == "equidistant" else "plumb_bob"
        if len(camera.distortion) == 8:
            model = "rational_polynomial"
        known = {
            "d": np.array(camera.distortion, float),
            "k": np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
            "r": np.eye(3).ravel(),
            "p": np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        }
        return self._make(
            "sensor_msgs/msg/CameraInfo",
            header=self._header(tick, frame),
            width=camera.size[0],
            height=camera.size[1],
            distortion_model=model,
            **{name.upper() if self._first else name: value for name, value in known.items()},
            binning_x=0,
            binning_y=0,
            roi=self._make(
                "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
            ),
        )

    def _header(self, tick: int, frame: str) -> Any:
        seconds, rest = divmod(tick, TICKS_PER_S)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest * 1000)
        counted = {"seq": 0} if self._first else {}
        return self._make("std_msgs/msg/Header", **counted, stamp=stamp, frame_id=frame)

    def _pose(self, pose: Pose) -> Any:
        w, x, y, z = pose.quaternion_wxyz().tolist()
        place = self._make("geometry_msgs/msg/Point", **dict(zip("xyz", pose.translation.tolist(), strict=True)))
        turn = self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        return self._make("geometry_msgs/msg/Pose", position=place, orientation=turn)

    def _make(self, type: str, **fields: Any) -> Any:
        return self._types[type](**fields)
