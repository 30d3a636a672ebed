"""The node: topics in, topics out. What it does with messages stands in `convert`, the robot between in `driven`."""

from pathlib import Path

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from teamslam.duty import read_duty
from teamslam.model import Submap, index_of
from teamslam.robot import Estimate
from teamslam.viewer.live import marks
from teamslam_ros.convert import Feed, filled, map_to_odometry, markers, path
from teamslam_ros.driven import Driven

MAKE = {"poses": PoseStamped, "markers": Marker, "transforms": TransformStamped}


class Robot(Node):
    """Parameters: `duty`, a TOML file as of `teamslam robot --config` with lines = true; `map_frame`,
    `odometry_frame`."""

    def __init__(self) -> None:
        super().__init__("teamslam")
        duty = read_duty(Path(self.declare_parameter("duty", "").value))
        self.map_frame = self.declare_parameter("map_frame", "map").value
        self.odometry_frame = self.declare_parameter("odometry_frame", "odom").value
        self.tf = self.create_publisher(TFMessage, "/tf", 10)
        self.path = self.create_publisher(PathMessage, "~/path", 1)
        self.marks = self.create_publisher(MarkerArray, "~/landmarks", 1)
        self.poses, self.now, self.shown = [], None, None
        self.robot = Driven(duty, self.show, self.get_logger().warning)
        self.feed = Feed(self.robot.dim)
        self.create_subscription(Odometry, "odom", self.on_odometry, 50)
        self.create_subscription(TFMessage, "/tf", self.feed.tags, 50)

    def on_odometry(self, message: Odometry) -> None:
        """Rows that are complete go to the robot's thread."""
        for row in self.feed.odometry(message):
            self.robot.tell(row)

    def show(self, now: Estimate, parts: tuple[Submap, ...]) -> None:
        """What is known now, on its topics; called by the robot's thread."""
        tick = int(index_of(now.key))
        if (odometry := self.feed.odometry_at(tick)) is not None:  # the same instant in both frames
            found = map_to_odometry(now.pose, odometry, tick, self.map_frame, self.odometry_frame)
            self.tf.publish(filled(TFMessage(), {"transforms": [found]}, MAKE))
        if now is not self.now:
            self.now, self.poses = now, [*self.poses, now.pose][-10_000:]
            self.path.publish(filled(PathMessage(), path(self.poses, tick, self.map_frame), MAKE))
        known = next((part for part in parts if part.base == now.frame), None)  # in the frame that poses are told in
        if known is not None and known is not self.shown:
            self.shown = known
            self.marks.publish(filled(MarkerArray(), markers(marks(known), tick, self.map_frame), MAKE))


def main() -> None:
    """`ros2 run teamslam_ros robot --ros-args -p duty:=/etc/teamslam/red.toml -r odom:=/red/odom`."""
    rclpy.init()
    node = Robot()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.robot.leave()
        node.destroy_node()
        rclpy.try_shutdown()
