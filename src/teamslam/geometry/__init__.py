"""Rotations, poses and rigid fits, for any batch shape, in the plane and in space."""

from teamslam.geometry.align import Fit, align
from teamslam.geometry.arrays import AnyArray, Array, BoolArray, FrozenDict, IntArray, Sealed, read_only, seal
from teamslam.geometry.earth import Anchor
from teamslam.geometry.pose import Pose, compose_along, concatenate, directions, lift_points, lift_tangent, rotations
from teamslam.geometry.registration import Registration, Told, register, turns_apart
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
    "Registration",
    "Sealed",
    "Told",
    "align",
    "compose_along",
    "concatenate",
    "direction_basis",
    "directions",
    "lift_points",
    "lift_tangent",
    "read_only",
    "register",
    "rotations",
    "seal",
    "turns_apart",
]
