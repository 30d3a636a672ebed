"""Landmarks whose rays meet only because the places that they come from are known badly.

A robot that turns on the spot has seen a landmark along one ray, whatever its odometry says of millimetres. Rays from
places no farther apart than odometry errs between them meet by chance, often next to the robot, and no Gaussian around
that point tells anything. What others saw of the landmark, or the robot later, may hold it: its bearings travel raw.
"""

import numpy as np

from teamslam.geometry import IntArray
from teamslam.joining.start.odometry import length_variances
from teamslam.model import Dataset, Values, is_landmark

BLUR = 2.0  # [sigmas of the way between two places], by which rays from there are told apart


def blurred(piece: Dataset, robot: int, way: Values) -> IntArray:
    """The landmarks that a piece tells of by bearings alone, taken by the robot along a `way` so short."""
    chain = piece.pose_keys[robot]
    others = [t.keys[:, -1] for t in piece.tables if t.model != "bearing"]
    seen = [
        t.keys[is_landmark(t.keys[:, 1]) & np.isin(t.keys[:, 0], chain)] for t in piece.tables if t.model == "bearing"
    ]
    rows = np.concatenate([np.zeros((0, 2), np.int64), *seen])
    rows = rows[~np.isin(rows[:, 1], np.concatenate([np.zeros(0, np.int64), *others]))]
    if not len(rows):
        return rows[:, 1]
    marks, mark = np.unique(rows[:, 1], return_inverse=True)
    step, places = np.searchsorted(chain, rows[:, 0]), way.positions(rows[:, 0], 3)
    first, last = np.full(len(marks), len(chain)), np.zeros(len(marks), np.int64)
    low, high = np.full((len(marks), 3), np.inf), np.full((len(marks), 3), -np.inf)
    for least, most, of in ((first, last, step), (low, high, places)):
        np.minimum.at(least, mark, of)
        np.maximum.at(most, mark, of)
    steps = length_variances(piece, robot, chain)
    known = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(steps), steps, 0.0))])
    apart = np.linalg.norm(high - low, axis=-1)
    return np.asarray(marks[apart <= BLUR * np.sqrt(known[last] - known[first])])
