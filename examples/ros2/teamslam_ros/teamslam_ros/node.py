"""The node: topics in, a robot of teamslam in a thread, topics out. What it does with messages stands in `convert`."""

import json
import queue
import threading
from pathlib import Path

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from teamslam.convoy import Driver
from teamslam.duty import read_duty
from teamslam.fleet import Member
from teamslam.io.plain.lines import Lines
from teamslam.live import begun, spoken
from teamslam.model import index_of, is_landmark
from teamslam.robot.journal import Journal
from teamslam.robot.link.keys import read_revocations, read_seal
from teamslam.robot.link.zenoh import ZenohLink
from teamslam.robot.peer import Peer
from teamslam.robot.rows import head_of
from teamslam_ros.convert import Feed, filled, map_to_odometry, markers, path

MAKE = {"poses": PoseStamped, "markers": Marker, "transforms": TransformStamped}


class Nobody:
    """The link of a robot that drives alone."""

    def send(self, to: int, data: bytes) -> None:
        """To nobody."""

    def receive(self, most: int = 0) -> list[tuple[int, bytes]]:
        """From nobody."""
        return []

    def close(self) -> None:
        """Nothing is open."""


class Robot(Node):
    """Parameters: `duty`, a TOML file as of `teamslam robot --config` with lines = true; `map_frame`,
    `odometry_frame`."""

    def __init__(self) -> None:
        super().__init__("teamslam")
        self.duty = read_duty(Path(self.declare_parameter("duty", "").value))
        self.map_frame = self.declare_parameter("map_frame", "map").value
        self.odometry_frame = self.declare_parameter("odometry_frame", "odom").value
        self.lines = Lines(self.duty.log, self.duty.robot)
        self.feed = Feed(self.lines.head.robots[self.lines.robot])
        self.told: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self.left, self.shown = threading.Event(), None
        self.create_subscription(Odometry, "odom", self.on_odometry, 50)
        self.create_subscription(TFMessage, "/tf", self.feed.tags, 50)
        self.tf = self.create_publisher(TFMessage, "/tf", 10)
        self.path = self.create_publisher(PathMessage, "~/path", 1)
        self.marks = self.create_publisher(MarkerArray, "~/landmarks", 1)
        self.poses = []
        self.thread = threading.Thread(target=self.drive, daemon=True)
        self.thread.start()

    def on_odometry(self, message: Odometry) -> None:
        """Rows that are complete go to the robot's thread."""
        for row in self.feed.odometry(message):
            self.told.put(json.dumps(row))

    def drive(self) -> None:
        """The robot, until the node ends."""
        duty, number, head = self.duty, self.lines.robot, self.lines.head
        address, peer = duty.address(number), Peer(number, duty.habits)
        if address is not None and address.certificates is not None:
            seal = read_seal(address.certificates, address.team, number, address.members, head.names)
            peer = Peer(number, duty.habits, seal).recalling(read_revocations(address.certificates))
        link = Nobody() if address is None else ZenohLink(address)
        duty.out.mkdir(parents=True, exist_ok=True)
        try:
            with Journal(duty.out / "journal.db", head_of(head, number)) as journal:
                memory = journal.recall()
                self.lines.goes_on_after(memory.tables, memory.names)
                member = Member(begun(head, number, duty.steps, memory), peer.recalling(memory.bodies), link)
                driver = Driver(member, journal, self.report, self.left.is_set, lambda: self.lines.names)
                rows = spoken(self.lines, iter(self.told.get, None), lambda e: self.get_logger().warning(str(e)), 0.02)
                driver.drive(rows, None)
        finally:
            link.close()

    def report(self, driver: Driver) -> None:
        """What is known now, on its topics."""
        member, keyframe = driver.member, self.feed.keyframe
        now = member.told[-1] if member.told else None
        member.told.clear()
        if now is None or keyframe is None:
            return
        tick = int(index_of(now.key))
        if tick == keyframe[0]:  # the same instant in both frames
            found = map_to_odometry(now.pose, keyframe[1], tick, self.map_frame, self.odometry_frame)
            self.tf.publish(filled(TFMessage(), {"transforms": [found]}, MAKE))
        self.poses = [*self.poses, now.pose][-10_000:]
        self.path.publish(filled(PathMessage(), path(self.poses, tick, self.map_frame), MAKE))
        known = member.mapper.atlas.joined
        if known is not None and known is not self.shown:
            self.shown, values, names = known, known.map.all_values, known.map.names
            keys = known.map.keys[is_landmark(known.map.keys)]
            places = {
                names.landmark(int(index_of(key))): values.positions(keys[n : n + 1], 3)[0]
                for n, key in enumerate(keys)
            }
            self.marks.publish(filled(MarkerArray(), markers(places, tick, self.map_frame), MAKE))

    def leave(self) -> None:
        """End the robot's thread: its last submap closes, and its journal."""
        self.left.set()
        self.told.put(None)
        self.thread.join(30.0)


def main() -> None:
    """`ros2 run teamslam_ros robot --ros-args -p duty:=/etc/teamslam/red.toml -r odom:=/red/odom`."""
    rclpy.init()
    node = Robot()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.leave()
        node.destroy_node()
        rclpy.try_shutdown()
