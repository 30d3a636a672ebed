"""Recordings written for tests, by the package that others write them with: ROS 1 bags, sqlite3 and MCAP."""

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from teamslam.io.bags.roles import DEFINITIONS

KINDS = ("bag", "mcap", "db3")


def store_of(kind):
    """All message types of ROS and of tag detectors."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    for name, text in {**DEFINITIONS, "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n"}.items():
        store.register(get_types_from_msg(text, name))
    return store


def write(folder, kind, messages):
    """A recording of (topic, type, stamp [ns] of its receipt, make), where `make(store, header)` gives a message and
    `header(stamp_ns, frame)` a header; returns the path to give to teamslam."""
    store = store_of(kind)
    path = folder / ("recording.bag" if kind == "bag" else "recording")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer1(path) if kind == "bag" else Writer2(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, type_, received, make in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_, typestore=store)
            found = make(store, header_for(store, kind))
            raw = store.serialize_ros1(found, type_) if kind == "bag" else store.serialize_cdr(found, type_)
            writer.write(connections[topic], received, raw)
    return path


def header_for(store, kind):
    """Makes headers of a store's own kind (ROS 1 counts them, ROS 2 does not)."""

    def header(stamp_ns, frame=""):
        time = store.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        number = {"seq": 0} if kind == "bag" else {}
        return store.types["std_msgs/msg/Header"](**number, stamp=time, frame_id=frame)

    return header


def odometry(topic, stamp_ns, position, quaternion_xyzw=(0.0, 0.0, 0.0, 1.0), received_ns=None):
    """One message of odometry."""

    def make(store, header):
        types = store.types
        pose = types["geometry_msgs/msg/Pose"](
            types["geometry_msgs/msg/Point"](*map(float, position)),
            types["geometry_msgs/msg/Quaternion"](*map(float, quaternion_xyzw)),
        )
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = types["geometry_msgs/msg/Twist"](zero, zero)
        return types["nav_msgs/msg/Odometry"](
            header(stamp_ns, "odom"),
            "base",
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.arange(36.0)),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )

    return topic, "nav_msgs/msg/Odometry", received_ns or stamp_ns, make


def detections(topic, stamp_ns, tags, received_ns=None, frame="camera"):
    """One message of tags: (id, corners (4, 2) as the AprilTag library counts pixels)."""

    def make(store, header):
        point = store.types["apriltag_msgs/msg/Point"]
        one = store.types["apriltag_msgs/msg/AprilTagDetection"]
        found = [
            one("tag36h11", number, 0, 0.0, 50.0, point(*np.mean(corners, 0).tolist()),
                [point(*map(float, corner)) for corner in corners], np.zeros(9))
            for number, corners in tags
        ]  # fmt: skip
        return store.types["apriltag_msgs/msg/AprilTagDetectionArray"](header(stamp_ns, frame), found)

    return topic, "apriltag_msgs/msg/AprilTagDetectionArray", received_ns or stamp_ns, make


def tag_poses(topic, stamp_ns, tags, type_):
    """One message of tags as poses: (id, rotation, place, edge [m]), by apriltag_ros or vision_msgs."""

    def make(store, header):
        types = store.types

        def pose(R, T):
            x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
            place = types["geometry_msgs/msg/Point"](*map(float, T))
            turn = types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)
            return types["geometry_msgs/msg/Pose"](place, turn)

        def noisy(R, T):
            return types["geometry_msgs/msg/PoseWithCovariance"](pose(R, T), np.zeros(36))

        found = []
        for number, R, T, edge in tags:
            if type_.startswith("apriltag_ros"):
                stamped = types["geometry_msgs/msg/PoseWithCovarianceStamped"](header(stamp_ns, "camera"), noisy(R, T))
                ids = np.atleast_1d(np.array(number, np.int32))
                found.append(types["apriltag_ros/msg/AprilTagDetection"](ids, np.full(len(ids), float(edge)), stamped))
                continue
            guess = types["vision_msgs/msg/ObjectHypothesis"](f"tag36h11:{number}", 1.0)
            result = types["vision_msgs/msg/ObjectHypothesisWithPose"](guess, noisy(R, T))
            size = types["geometry_msgs/msg/Vector3"](float(edge), float(edge), 0.0)
            box = types["vision_msgs/msg/BoundingBox3D"](pose(R, T), size)
            found.append(types["vision_msgs/msg/Detection3D"](header(stamp_ns, "camera"), [result], box, ""))
        return types[type_](header(stamp_ns, "camera"), found)

    return topic, type_, stamp_ns, make


def transform(
    topic, stamp_ns, parent, child, position, type="tf2_msgs/msg/TFMessage", quaternion_xyzw=(0.0, 0.0, 0.0, 1.0)
):
    """One transform as it is broadcast."""

    def make(store, header):
        types = store.types
        moved = types["geometry_msgs/msg/Transform"](
            types["geometry_msgs/msg/Vector3"](*map(float, position)),
            types["geometry_msgs/msg/Quaternion"](*map(float, quaternion_xyzw)),
        )
        one = types["geometry_msgs/msg/TransformStamped"](header(stamp_ns, parent), child, moved)
        return types[type]([one])

    return topic, type, stamp_ns, make


def camera_info(topic, stamp_ns, focal, centre, size, numbers=(), model="plumb_bob", matrix=None):
    """One calibration: focal lengths, centre and distortion of the raw image, the matrix (3, 4) of the rectified."""

    def make(store, header):
        first = "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__  # ROS 1 shouts the names
        (fx, fy), (cx, cy) = focal, centre
        known = {
            "d": np.array(numbers, float),
            "k": np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
            "r": np.eye(3).ravel(),
            "p": np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]) if matrix is None else matrix,
        }
        roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        return store.types["sensor_msgs/msg/CameraInfo"](
            header=header(stamp_ns, "camera"), width=size[0], height=size[1], distortion_model=model, binning_x=0,
            binning_y=0, roi=roi, **{name.upper() if first else name: value for name, value in known.items()},
        )  # fmt: skip

    return topic, "sensor_msgs/msg/CameraInfo", stamp_ns, make


def image(topic, stamp_ns, pixels, encoding="mono8", step=None, received_ns=None):
    """One raw image of bytes (h, w) or (h, w, channels)."""

    def make(store, header):
        height, width = pixels.shape[:2]
        data = np.frombuffer(pixels.tobytes(), np.uint8)
        length = step or data.size // height
        return store.types["sensor_msgs/msg/Image"](
            header(stamp_ns, "camera"), height, width, encoding, 0, length, data
        )

    return topic, "sensor_msgs/msg/Image", received_ns or stamp_ns, make


def compressed(topic, stamp_ns, data, format="png"):
    """One compressed image, of the bytes of a file."""

    def make(store, header):
        return store.types["sensor_msgs/msg/CompressedImage"](
            header(stamp_ns, "camera"), format, np.frombuffer(data, np.uint8)
        )

    return topic, "sensor_msgs/msg/CompressedImage", stamp_ns, make
