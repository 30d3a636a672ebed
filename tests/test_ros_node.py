"""The ROS 2 example: messages as they are typed in ROS 2, and the robot that they drive. Its node itself needs ROS and
is only compiled."""

import ast
import importlib
import itertools
import json
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from teamslam.duty import read_duty
from teamslam.geometry import Pose
from teamslam.io.plain.lines import Lines
from teamslam.live import drive
from teamslam.model import Submap, rebased
from teamslam.robot import Estimate, Robot
from teamslam.robot.journal import Journal
from teamslam.robot.opened import opened
from teamslam.robot.rows import head_of
from teamslam.viewer.live import marks
from teamslam.wire import receive
from teamslam.wire.messages import canonical

PACKAGE = Path(__file__).parents[1] / "examples" / "ros2" / "teamslam_ros"
typesys = pytest.importorskip("rosbags.typesys")
sys.path.insert(0, str(PACKAGE))
from teamslam_ros import convert, driven  # noqa: E402

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


def described(folder: Path, team: str = TEAM) -> Path:
    """A folder that says what rows hold."""
    folder.mkdir(exist_ok=True)
    (folder / "team.toml").write_text(team)
    (folder / "odometry.csv").write_text("from_stamp,to_stamp,x,y,theta\n")
    (folder / "tags.csv").write_text("stamp,landmark,x,y,z\n")
    return folder


@pytest.fixture
def lines(tmp_path: Path) -> Lines:
    return Lines(described(tmp_path))


TAGS = {"tag36h11:7": np.array([3.0, 1.0, 0.5]), "tag36h11:9": np.array([2.0, -2.0, 1.0])}


def heard_on_an_arc(feed: convert.Feed, noise: float = 0.0) -> Iterator[dict[str, Any]]:
    """The rows of a robot that drives along an arc, on and on: odometry in a frame of its own, and tags between two
    messages."""
    rng, begins = np.random.default_rng(0), Pose.from_xytheta(np.array([5.0, -3.0, 2.0]))

    def way(t: float) -> Pose:
        return Pose.from_tangent(np.array([0.5, 0.0, 0.1]) * t, 2)

    for n in itertools.count():
        tick = 1_700_000_000_000_000 + n * 50_000
        camera = way(0.05 * n + 0.02).lift(3) @ CAMERA
        feed.tags(tags(tick + 20_000, {k: camera.unact(m) + noise * rng.normal(size=3) for k, m in TAGS.items()}))
        yield from feed.odometry(odometry(tick, begins @ way(0.05 * n)))


def within(seconds: float, there: Callable[[], bool]) -> bool:
    """Whether something comes about in a time."""
    until = time.monotonic() + seconds
    while not there() and time.monotonic() < until:
        time.sleep(0.02)
    return there()


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
    found = rebased(submap, submap.first_pose).values.positions(submap.landmark_keys, 3)
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


Shown = list[tuple[Estimate, tuple[Submap, ...]]]


def test_the_robot_of_the_node_makes_its_map_beside_its_steps(tmp_path: Path) -> None:
    """In a process of its own: what the robot's own process has is submaps. They are those of the rows; one that was
    killed goes on from its journal; the frame of the map stands where the odometry was."""
    described(tmp_path / "rows")
    (tmp_path / "red.toml").write_text('log = "rows"\nout = "out"\nlines = true\n[steps]\nposes_per_piece = 12\n')
    duty, said, shown = read_duty(tmp_path / "red.toml"), list[str](), Shown()
    feed = convert.Feed(2)
    rows = list(itertools.islice(heard_on_an_arc(feed, 0.01), 350))
    for first, last in ((0, 150), (150, len(rows))):
        robot = driven.Driven(duty, lambda now, parts: shown.append((now, parts)), said.append)
        shown.clear()
        for row in rows[first : first + 60]:
            robot.tell(row)
        assert within(60.0, lambda: bool(shown and shown[-1][1]))
        coming = iter(rows[first + 60 : last])

        def in_the_map(robot: driven.Driven = robot, coming: Iterator[dict[str, Any]] = coming) -> bool:
            """Whether poses are told in the frame of the map; a row more each time."""
            if (row := next(coming, None)) is not None:
                robot.tell(row)
            return shown[-1][0].frame == shown[-1][1][0].base

        assert within(60.0, in_the_map)
        for row in coming:
            robot.tell(row)
        assert robot.leave(60.0) and robot.dim == 2 and robot.driver is not None
        mapper = robot.driver.member.mapper
        assert mapper.atlas.stretches and not mapper.atlas.short and not mapper.trouble
    now, parts = shown[-1]
    assert not said and set(marks(parts[0])) == {"7", "9"}
    lines = Lines(tmp_path / "rows")
    assert feed.odometry_at(int(now.key) & ((1 << 51) - 1)) is not None and feed.odometry_at(5) is None
    tables = [[lines.row(json.dumps(row))] for row in rows]
    *_, end = drive(Robot.of(lines.head, 1, duty.steps), tables, names=lambda: lines.names)
    with Journal(tmp_path / "out" / "journal.db", head_of(lines.head, 1)) as journal:
        bodies = [body.data for body in journal.recall().bodies]
    made = {receive(data).id: receive(data).submap() for data in bodies if not opened(data).entry.knows}
    assert sorted(map(canonical, made.values())) == sorted(map(canonical, end.atlas.submaps))


def test_robots_of_nodes_exchange_and_show_one_map(tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    with socket.socket() as one, socket.socket() as two:
        for probe in (one, two):
            probe.bind(("127.0.0.1", 0))
        places = [f"127.0.0.1:{probe.getsockname()[1]}" for probe in (one, two)]
    robots, shown = [], [Shown(), Shown()]
    names = '[[robot]]\nname = "red"\n[[robot]]\nname = "blue"\n'
    for n, name in enumerate(("red", "blue")):
        team = TEAM.replace('[[robot]]\nname = "red"\n', names).replace('robot = "red"', f'robot = "{name}"')
        described(tmp_path / name, team)
        (tmp_path / f"{name}.toml").write_text(
            f'log = "{name}"\nrobot = "{name}"\nout = "{name}-out"\nlines = true\n[steps]\nposes_per_piece = 12\n'
            f'[team]\nlisten = "{places[n]}"\nconnect = ["{places[1 - n]}"]\n'
        )
        add = shown[n].append
        robots.append(
            driven.Driven(read_duty(tmp_path / f"{name}.toml"), lambda now, parts, add=add: add((now, parts)), print)
        )
    rows = heard_on_an_arc(convert.Feed(2), 0.01)

    def of_both() -> bool:
        """Whether both show both; a row more each time."""
        row = next(rows)
        for robot in robots:
            robot.tell(row)
        return all(told and [p.robots_in_it for p in told[-1][1]] == [(1, 2)] for told in shown)

    assert within(90.0, of_both)
    assert all(robot.leave(60.0) for robot in robots)


def test_the_node_compiles_and_all_that_it_takes_of_teamslam_is_there() -> None:
    source = (PACKAGE / "teamslam_ros" / "node.py").read_text()
    compile(source, "node.py", "exec")
    for found in ast.walk(ast.parse(source)):
        if isinstance(found, ast.ImportFrom) and (found.module or "").startswith("teamslam"):
            module = importlib.import_module(str(found.module))
            assert all(hasattr(module, name.name) for name in found.names), found.module
    assert "never run" in (PACKAGE / "README.md").read_text()
