"""ROLES: what the messages of a type are for. DEFINITIONS: those types that ROS itself does not bring, for recordings
that do not carry their own definitions (sqlite3 before ROS 2 Iron).

Names are those of ROS 2 (`package/msg/Name`), also of ROS 1 bags.
Sources of the definitions: apriltag_msgs (christianrauch), isaac_ros_apriltag_interfaces, apriltag_ros, vision_msgs.
"""

import re

TRUTH = re.compile("mocap|motion_capture|vicon|vrpn|optitrack|qualisys|truth|(?:^|[/_])gt$", re.IGNORECASE)
"""What topics and frames of motion capture are called."""

ROLES: dict[str, str] = {
    "nav_msgs/msg/Odometry": "odometry",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose",
    "geometry_msgs/msg/TransformStamped": "pose",
    "tf2_msgs/msg/TFMessage": "transforms",
    "tf/msg/tfMessage": "transforms",
    "sensor_msgs/msg/Image": "image",
    "sensor_msgs/msg/CompressedImage": "image",
    "sensor_msgs/msg/CameraInfo": "calibration",
    "apriltag_msgs/msg/ApriltagArrayStamped": "tags",
    "apriltag_msgs/msg/AprilTagDetectionArray": "tags",
    "isaac_ros_apriltag_interfaces/msg/AprilTagDetectionArray": "tags",
    "apriltag_ros/msg/AprilTagDetectionArray": "tag poses",
    "vision_msgs/msg/Detection3DArray": "tag poses",
}

DEFINITIONS: dict[str, str] = {
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y\n",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "apriltag_msgs/Point centre\napriltag_msgs/Point[4] corners\nfloat64[9] homography\n"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_msgs/AprilTagDetection[] detections\n"
    ),
    "isaac_ros_apriltag_interfaces/msg/AprilTagDetection": (
        "string family\nint32 id\ngeometry_msgs/Point center\ngeometry_msgs/Point[4] corners\n"
        "geometry_msgs/PoseWithCovarianceStamped pose\n"
    ),
    "isaac_ros_apriltag_interfaces/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\nisaac_ros_apriltag_interfaces/AprilTagDetection[] detections\n"
    ),
    "apriltag_ros/msg/AprilTagDetection": (
        "int32[] id\nfloat64[] size\ngeometry_msgs/PoseWithCovarianceStamped pose\n"
    ),
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\n"
        "string id\n"
    ),
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
    "apriltag_ros/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_ros/AprilTagDetection[] detections\n"
    ),
}
