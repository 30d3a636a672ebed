"""Algorithm 1: a log in pieces, and a submap of each."""

from teamslam.joining.build.build import build, build_alternatives, build_choices, build_with_solution
from teamslam.joining.build.split import split

__all__ = [
    "build",
    "build_alternatives",
    "build_choices",
    "build_with_solution",
    "split",
]
