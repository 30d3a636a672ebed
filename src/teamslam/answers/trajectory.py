"""A robot's way through a map: where it was when, how turned, and how sure that is."""

from dataclasses import dataclass

import numpy as np

from teamslam.answers.columns import (
    POSE_ERRORS,
    Columns,
    Tabular,
    covariance_columns,
    pose_columns,
)
from teamslam.answers.maps import Maps, blocks_lifted, frame_of, poses_at, robot_found
from teamslam.errors import in_words
from teamslam.geometry import Array, Pose, Sealed, seal
from teamslam.model import Asked


@dataclass(frozen=True, eq=False)
class Trajectory(Sealed, Tabular):
    """The poses of one robot in time order, the base pose among them where it is the robot's.

    `stamps_s` (n,) [s], or counts where poses are only counted; `poses` (n,) body to map; `covariances`
    (n, dof, dof) of the errors [dT, dw], dT in the map's frame [m], dw in the body's own [rad]: those of the base,
    which is the frame, are 0. `frame` says in words what the map's frame is; `component`, which map it is, from 1.
    """

    robot: str
    stamps_s: Array
    poses: Pose
    covariances: Array
    frame: str
    component: int = 1

    def __post_init__(self) -> None:
        seal(self, "stamps_s", "covariances")

    def __repr__(self) -> str:
        kind = {2: "the plane", 3: "space"}[self.poses.dim]
        span = f", {self.stamps_s[0]:.3f} to {self.stamps_s[-1]:.3f}" if len(self) else ""
        return f"Trajectory(robot {in_words(self.robot)}: {len(self):,} poses of {kind}{span}, {in_words(self.frame)})"

    def __len__(self) -> int:
        return len(self.stamps_s)

    @property
    def positions(self) -> Array:
        """(n, d) [m]."""
        return self.poses.translation

    @property
    def rotations(self) -> Array:
        """(n, d, d), body to map."""
        return self.poses.rotation

    @property
    def headings(self) -> Array:
        """Yaw (n,) [rad], anticlockwise."""
        return self.poses.heading

    @property
    def quaternions_wxyz(self) -> Array:
        """(n, 4), the scalar first."""
        return self.poses.quaternion_wxyz()

    @property
    def sigmas(self) -> Array:
        """Standard deviations (n, dof) of the errors [dT, dw], [m] and [rad]."""
        return np.sqrt(np.maximum(np.diagonal(self.covariances, axis1=-2, axis2=-1), 0.0))

    def columns(self) -> Columns:
        """stamp_s, the pose and its covariance, as trajectories.csv has them."""
        errors = POSE_ERRORS[self.poses.dim]
        return {
            "stamp_s": self.stamps_s,
            **pose_columns(self.poses),
            **covariance_columns(self.covariances, errors),
        }


def trajectory_of(team: Maps, robot: Asked, component: int | None) -> Trajectory:
    """A robot's way in the one map that it is in (or in that of `component`). ModelError in words for a robot that is
    not there, or is in several maps."""
    number, key = robot_found(team, robot, component)
    submap = team.maps[number - 1]
    keys = submap.trajectory_keys(key)
    poses = poses_at(submap, keys)
    return Trajectory(
        robot=submap.names.robot(key),
        stamps_s=np.asarray(submap.names.stamps_s(keys), float),
        poses=poses,
        covariances=blocks_lifted(team.covariances[number - 1], submap, keys, poses.dim),
        frame=frame_of(submap),
        component=number,
    )
