"""The ROS 2 example converts messages as they are typed in ROS 2; its node itself needs ROS and is only compiled."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.io.plain.lines import Lines
from teamslam.live import drive
from teamslam.robot import Robot

PACKAGE = Path(__file__).parents[1] / "examples" / "ros2" / "teamslam_ros"
typesys = pytest.importorskip("rosbags.typesys")
sys.path.insert(0, str(PACKAGE))
from teamslam_ros import convert  # noqa: E402

STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
TYPES = STORE.types

TEAM = """keyframes = "given"
[[robot]]
name = "red"
[[log]]
file = "odometry.csv"
model = "relative_pose"
robot = "red"
sigma = [0.02, 0.01, 0.01]
[[log]]
file = "tags.csv"
model = "point"
robot = "red"
dim = 3
sigma = [0.05, 0.05, 0.1]
sensor = { x = 0.1, z = 0.3, qw = 0.5, qx = -0.5, qy = 0.5, qz = -0.5 }
"""
CAMERA = Pose.from_quaternion(np.array([0.1, 0.0, 0.3]), np.array([0.5, -0.5, 0.5, -0.5]))


def header(tick: int, frame: str) -> Any:
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=tick // 10**6, nanosec=tick % 10**6 * 1000)
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def odometry(tick: int, pose: Pose) -> Any:
    (x, y, z), (w, i, j, k) = pose.lift(3).translation, pose.lift(3).quaternion_wxyz()
    here = TYPES["geometry_msgs/msg/Pose"](
        position=TYPES["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=TYPES["geometry_msgs/msg/Quaternion"](x=i, y=j, z=k, w=w),
    )
    whole = TYPES["geometry_msgs/msg/PoseWithCovariance"](pose=here, covariance=np.zeros(36))
    none = TYPES["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = TYPES["geometry_msgs/msg/TwistWithCovariance"](
        twist=TYPES["geometry_msgs/msg/Twist"](linear=none, angular=none), covariance=np.zeros(36)
    )
    return TYPES["nav_msgs/msg/Odometry"](header=header(tick, "odom"), child_frame_id="base", pose=whole, twist=twist)


def tags(tick: int, seen: dict[str, np.ndarray]) -> Any:
    turn = TYPES["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    return TYPES["tf2_msgs/msg/TFMessage"](
        transforms=[
            TYPES["geometry_msgs/msg/TransformStamped"](
                header=header(tick, "camera"),
                child_frame_id=name,
                transform=TYPES["geometry_msgs/msg/Transform"](
                    translation=TYPES["geometry_msgs/msg/Vector3"](**dict(zip("xyz", map(float, at), strict=True))),
                    rotation=turn,
                ),
            )
            for name, at in seen.items()
        ]
    )


@pytest.fixture
def lines(tmp_path: Path) -> Lines:
    (tmp_path / "team.toml").write_text(TEAM)
    (tmp_path / "odometry.csv").write_text("from_stamp,to_stamp,x,y,theta\n")
    (tmp_path / "tags.csv").write_text("stamp,landmark,x,y,z\n")
    return Lines(tmp_path)


def test_odometry_and_tags_make_the_way_and_the_map(lines: Lines) -> None:
    """Along an arc, tags between two messages of odometry: all without noise, so what comes out is the truth."""
    feed, marks = convert.Feed(2), {"tag36h11:7": np.array([3.0, 1.0, 0.5]), "tag36h11:9": np.array([2.0, -2.0, 1.0])}
    begin, odometry_begins = 1_700_000_000_000_000, Pose.from_xytheta(np.array([5.0, -3.0, 2.0]))

    def way(t: float) -> Pose:  # an arc: odometry between two stamps is interpolated along it
        return Pose.from_tangent(np.array([0.5, 0.0, 0.1]) * t, 2)

    arrivals = []
    for n in range(60):
        tick = begin + n * 50_000
        feed.tags(tags(tick + 20_000, {k: (way(0.05 * n + 0.02).lift(3) @ CAMERA).unact(m) for k, m in marks.items()}))
        feed.tags(tags(tick, {"camera": np.zeros(3)}))
        rows = feed.odometry(odometry(tick, odometry_begins @ way(0.05 * n)))
        arrivals += [[lines.row(json.dumps(row))] for row in rows]
    *_, last, end = drive(Robot.of(lines.head, 1), arrivals, names=lambda: lines.names)
    assert feed.dropped == 0 and last.now is not None
    np.testing.assert_allclose(last.now.pose.translation, way(0.05 * 58 + 0.02).translation, atol=2e-3)
    (submap,) = end.submaps
    assert set(submap.names.landmarks.values()) <= {"7", "9"}
    found = submap.values.positions(submap.landmark_keys, 3)
    np.testing.assert_allclose(found[np.argsort(found[:, 1])], sorted(marks.values(), key=lambda m: m[1]), atol=5e-3)


def test_what_no_odometry_surrounds_is_counted(lines: Lines) -> None:
    feed = convert.Feed(2)
    feed.tags(tags(500_000, {"tag:1": np.ones(3)}))
    assert feed.odometry(odometry(1_000_000, Pose.identity(2))) == [] and feed.dropped == 1
    feed.tags(tags(2_000_000, {"tag:1": np.ones(3)}))
    rows = feed.odometry(odometry(9_000_000, Pose.identity(2)))
    assert feed.dropped == 2 and [row["file"] for row in rows] == ["odometry.csv"]


@pytest.mark.parametrize("dim", [2, 3])
def test_the_map_stands_where_the_robot_is(dim: int) -> None:
    rng = np.random.default_rng(dim)
    now, here = (Pose.from_tangent(rng.normal(size=3 if dim == 2 else 6), dim) for _ in range(2))
    found = convert.map_to_odometry(now, here, 5, "map", "odom")
    at, turn = found["transform"]["translation"], found["transform"]["rotation"]
    joint = convert.pose_of(SimpleNamespace(**at), SimpleNamespace(**turn), dim)
    np.testing.assert_allclose((joint @ here).translation, now.translation, atol=1e-12)


def test_every_field_that_is_filled_is_one_of_ros() -> None:
    def checked(values: Any, kind: str) -> None:
        known = dict(STORE.fielddefs[kind][1])
        for name, value in values.items():
            assert name in known, f"{kind} has no {name}"
            inner = str(known[name])
            of = [k for k in STORE.fielddefs if f"'{k}'" in inner]
            for each in value if isinstance(value, list) else [value]:
                if isinstance(each, dict):
                    checked(each, of[0])

    pose = Pose.identity(2)
    checked(convert.map_to_odometry(pose, pose, 5, "map", "odom"), "geometry_msgs/msg/TransformStamped")
    checked(convert.path([pose], 5, "map"), "nav_msgs/msg/Path")
    checked(convert.markers({"7": np.zeros(2)}, 5, "map"), "visualization_msgs/msg/MarkerArray")
    filled = convert.filled(
        SimpleNamespace(markers=None), convert.markers({"7": np.zeros(2)}, 5, "map"), {"markers": _marker}
    )
    assert filled.markers[0].pose.orientation.w == 1.0 and filled.markers[0].text == "7"


def _marker() -> SimpleNamespace:
    deep = {"header": SimpleNamespace(stamp=SimpleNamespace()), "scale": SimpleNamespace(), "color": SimpleNamespace()}
    return SimpleNamespace(**deep, pose=SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace()))


def test_the_node_compiles() -> None:
    source = (PACKAGE / "teamslam_ros" / "node.py").read_text()
    compile(source, "node.py", "exec")
    assert "never run" in (PACKAGE / "README.md").read_text()
