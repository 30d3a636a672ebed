"""Submaps made from logs, and joined into one map."""

from teamslam.joining.build import build, build_with_solution
from teamslam.joining.full import full
from teamslam.joining.join import Component, Joined, join
from teamslam.joining.split import split

__all__ = ["Component", "Joined", "build", "build_with_solution", "full", "join", "split"]
