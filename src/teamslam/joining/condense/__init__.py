"""Submaps that hold only what others need."""

from teamslam.joining.condense.condense import Interior, condense, condense_partially, expand, separators

__all__ = [
    "Interior",
    "condense",
    "condense_partially",
    "expand",
    "separators",
]
