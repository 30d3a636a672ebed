"""A robot that maps while it drives: a value that steps from row to row."""

from teamslam.robot.atlas import Atlas
from teamslam.robot.filter import Filter
from teamslam.robot.outlook import outlook
from teamslam.robot.robot import Counts, Estimate, Options, Piece, Robot

__all__ = ["Atlas", "Counts", "Estimate", "Filter", "Options", "Piece", "Robot", "outlook"]
