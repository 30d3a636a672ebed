"""Poses in messages: seven numbers, a place and a quaternion, and whether they can be a pose at all."""

from typing import Any

import numpy as np

from teamslam.geometry import Pose

FARTHEST_M = 1e8  # from an origin: what is farther (or no number) is damage, not a place


def seven_of(place: Any, turn: Any) -> list[float]:
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def is_pose(seven: list[float]) -> bool:
    """Whether numbers can be a pose: on Earth, with a quaternion of about unit length."""
    *place, x, y, z, w = seven
    return (
        all(abs(number) < FARTHEST_M for number in place)
        and all(abs(q) < 2.0 for q in (x, y, z, w))
        and (0.25 < x * x + y * y + z * z + w * w < 4.0)
    )


def poses_of(numbers: list[list[float]]) -> Pose:
    table = np.array(numbers, float).reshape(-1, 7)
    return Pose.from_quaternion(table[:, :3], table[:, [6, 3, 4, 5]])
