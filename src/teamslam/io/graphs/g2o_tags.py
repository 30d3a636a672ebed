"""EDGES and VERTICES: the words of g2o files and what they mean. Adding a tag is adding a row."""

from dataclasses import dataclass

from teamslam.model import Kind

NOTE = "# teamslam "  # a comment to other programs: names and the length of a tick, as JSON
PLAIN_IDS = 1 << 31  # g2o's own ids are 32-bit


@dataclass(frozen=True)
class Tag:
    """One row of EDGES: the model, its dimension, the kinds of vertices, and whether a parameter id stands before z."""

    model: str
    dim: int
    ends: tuple[Kind, ...]
    parameter: bool = False

    @property
    def numbers(self) -> int:
        """Numbers in the measurement as the file writes it."""
        return {"relative_pose": 0, "pose": 0, "bearing": 1}.get(self.model, self.dim) or (3 if self.dim == 2 else 7)

    @property
    def rows(self) -> int:
        """Rows of the information matrix."""
        return {"relative_pose": 0, "pose": 0, "bearing": 1}.get(self.model, self.dim) or (3 if self.dim == 2 else 6)


VERTICES: dict[str, Kind] = {
    "VERTEX_SE2": Kind.POSE2,
    "VERTEX_SE3:QUAT": Kind.POSE3,
    "VERTEX_XY": Kind.POINT2,
    "VERTEX_TRACKXYZ": Kind.POINT3,
}

FORMS = {Kind.POSE2: "x y theta", Kind.POSE3: "x y z qx qy qz qw", Kind.POINT2: "x y", Kind.POINT3: "x y z"}

EDGES: dict[str, Tag] = {
    "EDGE_SE2": Tag("relative_pose", 2, (Kind.POSE2, Kind.POSE2)),
    "EDGE_SE3:QUAT": Tag("relative_pose", 3, (Kind.POSE3, Kind.POSE3)),
    "EDGE_SE2_XY": Tag("point", 2, (Kind.POSE2, Kind.POINT2)),
    "EDGE_SE2_POINTXY_OFFSET": Tag("point", 2, (Kind.POSE2, Kind.POINT2), parameter=True),
    "EDGE_SE3_TRACKXYZ": Tag("point", 3, (Kind.POSE3, Kind.POINT3), parameter=True),
    "EDGE_BEARING_SE2_XY": Tag("bearing", 2, (Kind.POSE2, Kind.POINT2)),
    "EDGE_PRIOR_SE2": Tag("pose", 2, (Kind.POSE2,)),
    "EDGE_SE2_PRIOR": Tag("pose", 2, (Kind.POSE2,)),
    "EDGE_SE3_PRIOR": Tag("pose", 3, (Kind.POSE3,), parameter=True),
    "EDGE_PRIOR_SE2_XY": Tag("position", 2, (Kind.POSE2,)),
    "EDGE_SE3_XYZ_PRIOR": Tag("position", 3, (Kind.POSE3,), parameter=True),
    "EDGE_PRIOR_XY": Tag("position", 2, (Kind.POINT2,)),
    "EDGE_XYZ_PRIOR": Tag("position", 3, (Kind.POINT3,)),
}

PARAMETERS = {"PARAMS_SE2OFFSET": 2, "PARAMS_SE3OFFSET": 3}
