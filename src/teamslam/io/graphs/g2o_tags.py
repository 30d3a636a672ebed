"""EDGES and VERTICES: the words of g2o files and what they mean. Adding a tag is adding a row.

Where several rows mean the same, the first is g2o's own, and is written.
"""

from teamslam.io.graphs.tags import Tag
from teamslam.model import Kind

NOTE = "# teamslam "  # a comment to other programs: names and the length of a tick, as JSON
PLAIN_IDS = 1 << 31  # g2o's own ids are 32-bit

VERTICES: dict[str, tuple[Kind, str]] = {
    "VERTEX_SE2": (Kind.POSE2, "xytheta"),
    "VERTEX_SE3:QUAT": (Kind.POSE3, "quaternion"),
    "VERTEX_XY": (Kind.POINT2, "xy"),
    "VERTEX_TRACKXYZ": (Kind.POINT3, "xyz"),
    "VERTEX_POINT_XY": (Kind.POINT2, "xy"),
}

EDGES: dict[str, Tag] = {
    "EDGE_SE2": Tag("relative_pose", 2, (Kind.POSE2, Kind.POSE2), "xytheta"),
    "EDGE_SE3:QUAT": Tag("relative_pose", 3, (Kind.POSE3, Kind.POSE3), "quaternion"),
    "EDGE_SE2_XY": Tag("point", 2, (Kind.POSE2, Kind.POINT2), "xy"),
    "EDGE_SE2_POINTXY_OFFSET": Tag("point", 2, (Kind.POSE2, Kind.POINT2), "xy", parameter=True),
    "EDGE_SE2_POINT_XY": Tag("point", 2, (Kind.POSE2, Kind.POINT2), "xy", parameter=True),
    "LANDMARK2": Tag("point", 2, (Kind.POSE2, Kind.POINT2), "xy"),
    "EDGE_SE3_TRACKXYZ": Tag("point", 3, (Kind.POSE3, Kind.POINT3), "xyz", parameter=True),
    "EDGE_BEARING_SE2_XY": Tag("bearing", 2, (Kind.POSE2, Kind.POINT2), "bearing"),
    "EDGE_PRIOR_SE2": Tag("pose", 2, (Kind.POSE2,), "xytheta"),
    "EDGE_SE2_PRIOR": Tag("pose", 2, (Kind.POSE2,), "xytheta"),
    "EDGE_SE3_PRIOR": Tag("pose", 3, (Kind.POSE3,), "quaternion", parameter=True),
    "EDGE_PRIOR_SE2_XY": Tag("position", 2, (Kind.POSE2,), "xy"),
    "EDGE_SE3_XYZ_PRIOR": Tag("position", 3, (Kind.POSE3,), "xyz", parameter=True),
    "EDGE_PRIOR_XY": Tag("position", 2, (Kind.POINT2,), "xy"),
    "EDGE_POINTXYZ_PRIOR": Tag("position", 3, (Kind.POINT3,), "xyz"),
    "EDGE_XYZ_PRIOR": Tag("position", 3, (Kind.POINT3,), "xyz"),
}

PARAMETERS = {"PARAMS_SE2OFFSET": 2, "PARAMS_SE2_OFFSET": 2, "PARAMS_SE3OFFSET": 3}
TUTORIAL = "TUTORIAL_"  # before every tag of g2o's own tutorial
