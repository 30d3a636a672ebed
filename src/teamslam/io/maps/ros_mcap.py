"""Maps for ROS 2: a recording (MCAP) with what RViz and others show, played by `ros2 bag play DIR`.

    /teamslam/ROBOT/path     nav_msgs/Path: a robot's way, each pose at its stamp, in the frame `map`
    /teamslam/landmarks      visualization_msgs/MarkerArray: of each landmark the ball of its 95 % region, and its name

All messages stand at the last stamp of the log; of logs that count poses, a pose is a second. Several maps are
folders of their own, as their frames are.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.errors import InputError, MissingExtraError
from teamslam.geometry import Array, Pose
from teamslam.io.files.whole import beside
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.marks import Mark, lost, marks_in
from teamslam.io.maps.space import Course, courses
from teamslam.model import Dropped

FRAME = "map"
SPHERE, TEXT, ADD = 2, 9, 0  # of visualization_msgs/Marker
SMALLEST_M, LETTERS_M = 1e-3, 0.2  # of what is drawn
LATEST_S = 2**31 - 1  # that a stamp of ROS 2 holds


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map as a folder that is a recording. Law: a reader of recordings finds the map's poses and places.
    MissingExtraError without `rosbags`; InputError for stamps that ROS has none for, or two names of one topic."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError("writing recordings needs rosbags: pip install 'teamslam[bags]'") from None
    types = get_typestore(Stores.ROS2_HUMBLE)
    for found, folder in zip(maps, paths_of(path, len(maps)), strict=True):
        ways = list(courses(found))
        messages = _Messages(types, _last_stamp(ways))
        topics = {**messages.paths(ways), "/teamslam/landmarks": messages.markers(list(marks_in(found)))}
        draft = beside(folder)
        with Writer(draft, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            for topic, message in topics.items():
                kind = message.__msgtype__
                connection = bag.add_connection(topic, kind, typestore=types)
                bag.write(connection, messages.last_ns, types.serialize_cdr(message, kind))
        draft.rename(folder)
    return lost(maps, "covariances of poses: nav_msgs/Path has none")


def _last_stamp(ways: Sequence[Course]) -> float:
    stamps = np.concatenate([np.zeros(1), *(course.stamps_s for course in ways)])
    if stamps.min() < 0.0 or stamps.max() > LATEST_S:
        raise InputError(f"ROS holds stamps from 0 to {LATEST_S} s, found {stamps.min():g} to {stamps.max():g}")
    return float(stamps.max())


class _Messages:
    """Messages of a map, in the words of ROS 2."""

    def __init__(self, types: Any, last_s: float) -> None:
        self._types, self._last_s = types.types, last_s
        self.last_ns = round(last_s * 1e9)

    def paths(self, ways: Sequence[Course]) -> dict[str, Any]:
        """A path for each robot, by its topic."""
        found: dict[str, Any] = {}
        for course in ways:
            topic = f"/teamslam/{_word(course.robot)}/path"
            if topic in found:
                raise InputError(f"two robots' names make one topic of ROS, {topic}; give them other names")
            poses = [self._stamped(stamp, course.poses[n]) for n, stamp in enumerate(course.stamps_s.tolist())]
            found[topic] = self._make("nav_msgs/msg/Path", header=self._header(self._last_s), poses=poses)
        return found

    def _stamped(self, stamp_s: float, pose: Pose) -> Any:
        return self._make("geometry_msgs/msg/PoseStamped", header=self._header(stamp_s), pose=self._pose(pose))

    def markers(self, marks: Sequence[Mark]) -> Any:
        """Balls and names of landmarks."""
        balls = [self._ball(n, mark) for n, mark in enumerate(marks)]
        names = [self._name(n, mark) for n, mark in enumerate(marks)]
        return self._make("visualization_msgs/msg/MarkerArray", markers=[*balls, *names])

    def _ball(self, number: int, mark: Mark) -> Any:
        radii, axes = mark.region(3)
        size = np.maximum(2.0 * radii, SMALLEST_M)
        return self._marker("landmarks", number, SPHERE, Pose(axes, mark.position), size, (0.48, 0.12, 0.36, 0.6))

    def _name(self, number: int, mark: Mark) -> Any:
        above = Pose(np.eye(3), mark.position + np.array([0.0, 0.0, LETTERS_M]))
        size = np.full(3, LETTERS_M)
        return self._marker("names", number, TEXT, above, size, (0.1, 0.1, 0.1, 1.0), mark.name)

    def _marker(
        self, ns: str, number: int, kind: int, pose: Pose, size: Array, colour: tuple[float, ...], text: str = ""
    ) -> Any:
        red, green, blue, opacity = colour
        return self._make(
            "visualization_msgs/msg/Marker",
            header=self._header(self._last_s),
            ns=ns,
            id=number,
            type=kind,
            action=ADD,
            pose=self._pose(pose),
            scale=self._make("geometry_msgs/msg/Vector3", **dict(zip("xyz", size.tolist(), strict=True))),
            color=self._make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=opacity),
            lifetime=self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=self._no_texture(),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )

    def _no_texture(self) -> Any:
        header = self._header(0.0)
        return self._make("sensor_msgs/msg/CompressedImage", header=header, format="", data=np.zeros(0, np.uint8))

    def _header(self, stamp_s: float) -> Any:
        seconds, rest = divmod(round(stamp_s * 1e9), 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=FRAME)

    def _pose(self, pose: Pose) -> Any:
        w, x, y, z = pose.quaternion_wxyz().tolist()
        place = self._make("geometry_msgs/msg/Point", **dict(zip("xyz", pose.translation.tolist(), strict=True)))
        turn = self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        return self._make("geometry_msgs/msg/Pose", position=place, orientation=turn)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)


def _word(name: str) -> str:
    """A name as a part of a topic: letters, digits and underscores, no digit first."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name) or "_"
    return f"robot_{plain}" if plain[0].isdigit() else plain
