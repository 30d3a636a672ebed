"""Questions by name, for whoever has a team's maps and their covariances: a join, a run, a run read back.

    team.robots, team.landmark_names                names, to ask with
    team.trajectory("red")                          where a robot was when, with covariances
    team.landmarks, team.landmark("door")           where landmarks are
    team.covariance("door", "red@12.5")             how sure things are together
    team.relative("door", seen_from="red@12.5")     one as seen from another, with its covariance
    team.residuals()                                how far every row of the log is off

Robots that could not be joined have maps with frames of their own; what is in several of them is asked for with
`component=`, counted from 1.
"""

from teamslam.answers.covariance import JointCovariance, Relative, joint_of, relative_of
from teamslam.answers.landmarks import Landmark, Landmarks, landmark_of, landmarks_of
from teamslam.answers.maps import Maps, landmark_names_in, robots_in
from teamslam.answers.trajectory import Trajectory, trajectory_of
from teamslam.model import Asked


class Answers:
    """What a team's maps answer by name."""

    @property
    def robots(self: Maps) -> tuple[str, ...]:
        """The names of the robots that are in a map."""
        return robots_in(self)

    @property
    def landmark_names(self: Maps) -> tuple[str, ...]:
        """The names of the landmarks that are in a map."""
        return landmark_names_in(self)

    @property
    def landmarks(self: Maps) -> Landmarks:
        """All landmarks, with their covariances."""
        return landmarks_of(self)

    def landmark(self: Maps, name: Asked, *, component: int | None = None) -> Landmark:
        """One landmark by name: where it is, how sure, and how it is turned where that was measured."""
        return landmark_of(self, name, component)

    def trajectory(self: Maps, robot: Asked, *, component: int | None = None) -> Trajectory:
        """A robot's poses in time order, the base of the map among them, with stamps and covariances."""
        return trajectory_of(self, robot, component)

    def covariance(self: Maps, *things: Asked, component: int | None = None) -> JointCovariance:
        """The joint covariance of landmarks and poses, such as 'door' and 'red@12.5', in the map's frame."""
        return joint_of(self, things, component)

    def relative(self: Maps, target: Asked, *, seen_from: Asked, component: int | None = None) -> Relative:
        """A landmark or pose as seen from a pose, with the covariance of that: what planning and grasping want."""
        return relative_of(self, target, seen_from, component)
