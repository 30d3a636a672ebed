"""Exact rounds between robots."""

from teamslam.robot.rounds.course import Account
from teamslam.robot.rounds.rounds import Rounds

__all__ = ["Account", "Rounds"]
