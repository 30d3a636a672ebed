"""EDGES and VERTICES: the words of TORO's and iSAM's text graphs and what they mean. Adding a tag is adding a row.

    TORO    VERTEX2 id x y theta                    EDGE2 id id x y theta  I11 I12 I22 I33 I13 I23
            VERTEX3 id x y z roll pitch yaw         EDGE3 id id x y z roll pitch yaw  upper triangle
    iSAM    ODOMETRY or EDGE2 id id x y theta  R11 R12 R13 R22 R23 R33      EDGE3 as above, with R
            LANDMARK id id x y  R11 R12 R22         POINT3 id id x y z  R11 ...
            POSE3D_INIT, POSE3D_TRUE id x y z roll pitch yaw
    GTSAM   BR id id bearing range  sigma sigma

What the noise is (I, R or a covariance) is told by `toro_noise`.
"""

from teamslam.io.graphs.tags import Tag
from teamslam.model import Kind

_POSES2, _POSES3 = (Kind.POSE2, Kind.POSE2), (Kind.POSE3, Kind.POSE3)

VERTICES: dict[str, tuple[Kind, str]] = {
    "VERTEX2": (Kind.POSE2, "xytheta"),
    "VERTEX": (Kind.POSE2, "xytheta"),
    "VERTEX3": (Kind.POSE3, "euler"),
    "POSE3D_INIT": (Kind.POSE3, "euler"),
}

TRUTH: dict[str, tuple[Kind, str]] = {"POSE3D_TRUE": (Kind.POSE3, "euler")}

EDGES: dict[str, Tag] = {
    "EDGE2": Tag("relative_pose", 2, _POSES2, "xytheta"),
    "EDGE": Tag("relative_pose", 2, _POSES2, "xytheta"),
    "ODOMETRY": Tag("relative_pose", 2, _POSES2, "xytheta"),
    "Constraint2": Tag("relative_pose", 2, _POSES2, "xytheta"),
    "EDGE3": Tag("relative_pose", 3, _POSES3, "euler"),
    "LANDMARK": Tag("point", 2, (Kind.POSE2, Kind.POINT2), "xy"),
    "POINT3": Tag("point", 3, (Kind.POSE3, Kind.POINT3), "xyz"),
    "BR": Tag("range_bearing", 2, (Kind.POSE2, Kind.POINT2), "bearing range"),
}

SIGMAS = ("BR",)  # their noise is standard deviations, in the order of the value
TORO = ("VERTEX2", "VERTEX", "VERTEX3", "EQUIV")  # lines of which iSAM's files have none
REPEATS = {"EQUIV": "EQUIV lines: the edges between the two vertices say what is known; both vertices stay"}
