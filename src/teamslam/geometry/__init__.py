"""Rotations, poses and rigid fits, for any batch shape, in the plane and in space."""

from teamslam.geometry.align import Fit, align
from teamslam.geometry.arrays import AnyArray, Array, BoolArray, IntArray
from teamslam.geometry.pose import Pose, concatenate, lift_points, lift_tangent, rotations

__all__ = [
    "AnyArray",
    "Array",
    "BoolArray",
    "Fit",
    "IntArray",
    "Pose",
    "align",
    "concatenate",
    "lift_points",
    "lift_tangent",
    "rotations",
]
