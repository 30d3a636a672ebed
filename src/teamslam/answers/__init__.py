"""What a team's maps answer when they are asked by name: ways, landmarks, covariances, residuals, as records."""

from teamslam.answers.answers import Answers
from teamslam.answers.covariance import JointCovariance, Relative
from teamslam.answers.landmarks import Landmark, Landmarks
from teamslam.answers.residuals import Residual, Residuals, ResidualTable
from teamslam.answers.trajectory import Trajectory

__all__ = [
    "Answers",
    "JointCovariance",
    "Landmark",
    "Landmarks",
    "Relative",
    "Residual",
    "ResidualTable",
    "Residuals",
    "Trajectory",
]
