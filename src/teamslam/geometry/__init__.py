"""Rotations, poses and rigid fits, for any batch shape, in the plane and in space."""

from teamslam.geometry.align import Fit, align, align_known
from teamslam.geometry.arrays import AnyArray, Array, BoolArray, FrozenDict, IntArray, Sealed, read_only, seal
from teamslam.geometry.earth import Anchor
from teamslam.geometry.pose import Pose, compose_along, concatenate, directions, lift_points, lift_tangent, rotations
from teamslam.geometry.s2 import direction_basis

__all__ = [
    "Anchor",
    "AnyArray",
    "Array",
    "BoolArray",
    "Fit",
    "FrozenDict",
    "IntArray",
    "Pose",
    "Sealed",
    "align",
    "align_known",
    "compose_along",
    "concatenate",
    "direction_basis",
    "directions",
    "lift_points",
    "lift_tangent",
    "read_only",
    "rotations",
    "seal",
]
