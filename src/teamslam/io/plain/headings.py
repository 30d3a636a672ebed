"""Headings of odometry that are in degrees, told by where the robot goes.

A robot on wheels goes where it points, forwards or backwards. Of steps of length l in direction c, at heading t,

    R(f) = | sum l exp(2i (c - f t)) | / sum l

is near 1 where the headings are read right, f = 1 for radians and pi / 180 for degrees, and near 0 where they are not;
f = 0 says how straight on the way is. Degrees are told where they alone explain it.
"""

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.io.files.csv_file import Csv

FEWEST = 10  # steps
RIGHT, WRONG = 0.9, 0.6  # R of headings that are read right, and that are not


def notes_of_headings(csv: Csv, robots: IntArray) -> list[str]:
    """Words on a file of odometry poses in the plane, of which each row is one of `robots` (m,), where the headings of
    one are in degrees; none where that cannot be told."""
    xytheta = csv.numbers("x", "y", "theta")
    if not any(_in_degrees(xytheta[robots == robot]) for robot in np.unique(robots)):
        return []
    return [
        f"{csv.path}, field 'theta': the robot goes where this points if it is in degrees, and not if it is in "
        "radians; expected radians: if these are degrees, multiply with pi / 180"
    ]


def _in_degrees(xytheta: Array) -> bool:
    steps = np.diff(xytheta[:, 0] + 1j * xytheta[:, 1])
    heading = 0.5 * (xytheta[1:, 2] + xytheta[:-1, 2])
    length = np.abs(steps)
    moved = length > 1e-3 * length.sum() / max(len(steps), 1)
    if np.count_nonzero(moved) < FEWEST:
        return False
    heading, length, course = heading[moved], length[moved], np.angle(steps[moved])

    def explained(factor: float) -> float:
        return float(np.abs(np.sum(length * np.exp(2j * (course - factor * heading)))) / length.sum())

    return explained(np.pi / 180.0) > RIGHT and max(explained(1.0), explained(0.0)) < WRONG
