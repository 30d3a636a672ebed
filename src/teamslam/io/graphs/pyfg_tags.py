"""TAGS and VERTICES: the words of PyFG files and what they mean. Adding a tag is adding a row."""

from teamslam.io.graphs.tags import Tag
from teamslam.model import Kind

TICKS_PER_S = 1_000_000
RANGE = "EDGE_RANGE"

VERTICES: dict[str, tuple[Kind, str]] = {
    "VERTEX_SE2": (Kind.POSE2, "xytheta"),
    "VERTEX_SE3:QUAT": (Kind.POSE3, "quaternion"),
    "VERTEX_XY": (Kind.POINT2, "xy"),
    "VERTEX_XYZ": (Kind.POINT3, "xyz"),
}

TAGS: dict[str, Tag] = {
    "VERTEX_SE2:PRIOR": Tag("pose", 2, (Kind.POSE2,), "xytheta"),
    "VERTEX_SE3:QUAT:PRIOR": Tag("pose", 3, (Kind.POSE3,), "quaternion"),
    "VERTEX_XY:PRIOR": Tag("position", 2, (Kind.POINT2,), "xy"),
    "VERTEX_XYZ:PRIOR": Tag("position", 3, (Kind.POINT3,), "xyz"),
    "EDGE_SE2": Tag("relative_pose", 2, (Kind.POSE2, Kind.POSE2), "xytheta"),
    "EDGE_SE3:QUAT": Tag("relative_pose", 3, (Kind.POSE3, Kind.POSE3), "quaternion"),
    "EDGE_SE2_XY": Tag("point", 2, (Kind.POSE2, Kind.POINT2), "xy"),
    "EDGE_SE3_XYZ": Tag("point", 3, (Kind.POSE3, Kind.POINT3), "xyz"),
}
