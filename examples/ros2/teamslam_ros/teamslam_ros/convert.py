"""Messages of ROS as rows of teamslam, and what teamslam knows as fields of messages. It needs no ROS: messages are
whatever has their fields.

    nav_msgs/Odometry       poses in a frame that drifts, (odometry of one since the last keyframe
                            every `every_s`, and wherever a tag was seen)
    tf2_msgs/TFMessage      tags in the camera's frame, as apriltag_ros of ROS 2 tells them: child_frame_id tag36h11:7
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teamslam.frontend.interpolate import interpolate
from teamslam.geometry import Pose, concatenate

TICKS_PER_S = 1_000_000
KEPT = 1000  # keyframes that the robot may be behind
Row = dict[str, Any]


def tick_of(stamp: Any) -> int:
    """A builtin_interfaces/Time [ticks of a microsecond]."""
    return int(stamp.sec) * TICKS_PER_S + int(stamp.nanosec) // 1000


def pose_of(position: Any, orientation: Any, dim: int) -> Pose:
    """A geometry_msgs Point (or Vector3) and Quaternion, of a robot in space or onto the plane."""
    place = np.array([position.x, position.y, position.z])
    turn = np.array([orientation.w, orientation.x, orientation.y, orientation.z])
    return Pose.from_quaternion(place, turn / np.linalg.norm(turn)).onto(dim)


@dataclass
class Feed:
    """What was heard, until it can be told as rows: keyframes every `every_s`, and where a tag was seen, between two
    messages of odometry at most `gap_s` apart. `odometry_file` and `tags_file` name the files of team.toml.

    `dropped` counts sightings that no odometry surrounds.
    """

    dim: int
    every_s: float = 0.2
    gap_s: float = 1.0
    odometry_file: str = "odometry.csv"
    tags_file: str = "tags.csv"
    dropped: int = 0
    keyframe: tuple[int, Pose] | None = None
    _heard: list[tuple[int, Pose]] = field(default_factory=list)
    _waiting: dict[int, list[Row]] = field(default_factory=dict)
    _kept: dict[int, Pose] = field(default_factory=dict)

    def odometry_at(self, tick: int) -> Pose | None:
        """The odometry at one of the last keyframes; None where it was none of these. May be asked from any thread."""
        return self._kept.get(tick)

    def tags(self, message: Any, prefix: str = "tag") -> None:
        """Tags of a tf2_msgs/TFMessage wait for the odometry after them."""
        for transform in message.transforms:
            if not transform.child_frame_id.startswith(prefix):
                continue
            name, at = transform.child_frame_id.rpartition(":")[2], transform.transform.translation
            row = {"file": self.tags_file, "landmark": name, "x": float(at.x), "y": float(at.y), "z": float(at.z)}
            self._waiting.setdefault(tick_of(transform.header.stamp), []).append(row)

    def odometry(self, message: Any) -> list[Row]:
        """The rows that a nav_msgs/Odometry completes, in order of time."""
        tick = tick_of(message.header.stamp)
        pose = pose_of(message.pose.pose.position, message.pose.pose.orientation, self.dim)
        if self._heard and tick <= self._heard[-1][0]:
            return []
        self._heard.append((tick, pose))
        if self.keyframe is None:
            self._begins(tick, pose)
        assert self.keyframe is not None
        rows: list[Row] = []
        for due in self._due(tick):
            rows += self._step(due)
            rows += [{**row, "stamp": due / TICKS_PER_S} for row in self._waiting.pop(due, [])]
        self._heard = [(t, p) for t, p in self._heard if t >= self.keyframe[0]] or self._heard[-1:]
        return rows

    def _due(self, tick: int) -> list[int]:
        """The stamps up to now at which a keyframe is due; sightings from before the last keyframe are dropped."""
        assert self.keyframe is not None
        last = self.keyframe[0]
        seen = sorted(t for t in self._waiting if t <= tick)
        for late in [t for t in seen if t < last]:
            self.dropped += len(self._waiting.pop(late))
        due = {t for t in seen if t >= last}
        return sorted(due | ({tick} if tick - last >= self.every_s * TICKS_PER_S else set()))

    def _step(self, due: int) -> list[Row]:
        """The odometry from the last keyframe to one at a stamp."""
        assert self.keyframe is not None
        last, before = self.keyframe
        if due == last:
            return []
        stamps = np.array([t for t, _ in self._heard])
        poses = concatenate([pose[None] for _, pose in self._heard])
        found, good = interpolate(stamps, poses, np.array([due]), round(self.gap_s * TICKS_PER_S))
        if not good[0]:
            self.dropped += len(self._waiting.pop(due, []))
            return []
        self._begins(due, found[0])
        moved = before.between(found[0])
        names = ("x", "y", "theta") if self.dim == 2 else ("x", "y", "z", "qw", "qx", "qy", "qz")
        numbers = moved.xytheta() if self.dim == 2 else np.r_[moved.translation, moved.quaternion_wxyz()]
        stamps_s = {"from_stamp": last / TICKS_PER_S, "to_stamp": due / TICKS_PER_S}
        return [{"file": self.odometry_file, **stamps_s, **dict(zip(names, numbers.tolist(), strict=True))}]

    def _begins(self, tick: int, pose: Pose) -> None:
        """A keyframe more."""
        self.keyframe = (tick, pose)
        self._kept[tick] = pose
        if len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]


# --- what is known, as fields of messages -----------------------------------------------------------------------------


def fields_of_pose(pose: Pose) -> Row:
    """A geometry_msgs/Pose."""
    (x, y, z), (w, i, j, k) = (a.tolist() for a in (pose.lift(3).translation, pose.lift(3).quaternion_wxyz()))
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"w": w, "x": i, "y": j, "z": k}}


def fields_of_time(tick: int) -> Row:
    """A builtin_interfaces/Time."""
    return {"sec": tick // TICKS_PER_S, "nanosec": tick % TICKS_PER_S * 1000}


def map_to_odometry(now: Pose, odometry: Pose, tick: int, map_frame: str, odometry_frame: str) -> Row:
    """A geometry_msgs/TransformStamped from the map to the frame of the odometry, so that the robot stands where it is
    now known to be: map_T_odom = map_T_base odom_T_base^-1."""
    pose = fields_of_pose(now @ odometry.inverse())
    return {
        "header": {"stamp": fields_of_time(tick), "frame_id": map_frame},
        "child_frame_id": odometry_frame,
        "transform": {"translation": pose["position"], "rotation": pose["orientation"]},
    }


def path(poses: Sequence[Pose], tick: int, map_frame: str) -> Row:
    """A nav_msgs/Path."""
    header = {"stamp": fields_of_time(tick), "frame_id": map_frame}
    return {"header": header, "poses": [{"header": header, "pose": fields_of_pose(pose)} for pose in poses]}


def markers(places: Mapping[str, Iterable[float]], tick: int, map_frame: str) -> Row:
    """A visualization_msgs/MarkerArray: a ball for each landmark."""
    return {
        "markers": [
            {
                "header": {"stamp": fields_of_time(tick), "frame_id": map_frame},
                "ns": "landmarks",
                "id": number,
                "type": 2,
                "action": 0,
                "pose": {
                    "position": dict(zip("xyz", [*map(float, place), 0.0][:3], strict=True)),
                    "orientation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
                },
                "scale": {"x": 0.2, "y": 0.2, "z": 0.2},
                "color": {"r": 0.1, "g": 0.4, "b": 0.8, "a": 1.0},
                "text": name,
            }
            for number, (name, place) in enumerate(sorted(places.items()))
        ]
    }


def filled(message: Any, values: Row, make: Mapping[str, Any]) -> Any:
    """A message with fields as they are in a nested dict; `make` makes the messages within lists, by the name of the
    list."""
    for name, value in values.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value, make)
        elif isinstance(value, list):
            setattr(message, name, [filled(make[name](), each, make) for each in value])
        else:
            setattr(message, name, value)
    return message
