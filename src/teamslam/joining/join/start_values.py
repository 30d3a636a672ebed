"""The start of a join: the variables of all submaps in the common frame, once the submaps are placed."""

from collections.abc import Sequence

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.place.stack import Stack
from teamslam.model import Kind, Values, unpack


def start_values(stack: Stack, frames: Sequence[Pose]) -> Values:
    """Every variable where the first submap that knows it puts it; a base counts before what others say of it.

    What one submap holds as a pose and others as a point (a tag, of which these saw the place alone) is a pose. A pose
    that one holds as planar and another as spatial is planar: the robot itself knows that it is on the ground; a point
    is in space where anybody saw it there. Raises ModelError where a submap in space holds something planar.
    """
    whole = stack.with_bases
    chosen = _first_that_says_most(whole.keys, whole.kinds)
    dims = np.array([frame.dim for frame in frames])
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
    for kind in map(Kind, np.unique(whole.kinds[chosen]).tolist()):
        rows = chosen[whole.kinds[chosen] == kind]
        holders, at = np.unique(whole.holder[rows], return_inverse=True)
        if (dims[holders] > kind.dim).any():
            raise ModelError("a spatial pose cannot be put into the plane without loss")
        common = _lifted([frames[h] for h in holders.tolist()], kind.dim)[at]
        local = unpack(whole.state[whole.start[rows, None] + np.arange(kind.size)], kind)
        parts[kind] = (whole.keys[rows], common @ local if isinstance(local, Pose) else common.act(local))
    return Values.of(parts)


PRECEDENCE = np.array([0, 1, 3, 2])  # of kinds: planar poses, poses in space, points in the plane, points in space


def _first_that_says_most(keys: IntArray, kinds: IntArray) -> IntArray:
    """One row for each key, in the order of keys: of its rows of the kind that goes before the others the first."""
    order = np.argsort(keys)
    begins = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0]))
    return np.minimum.reduceat((PRECEDENCE[kinds] * len(keys) + np.arange(len(keys)))[order], begins) % len(keys)


def _lifted(poses: Sequence[Pose], dim: int) -> Pose:
    """Poses as a batch in `dim` dimensions."""
    lifted = [pose.lift(dim) for pose in poses]
    rotation = np.concatenate([pose.rotation for pose in lifted]).reshape(-1, dim, dim)
    return Pose(rotation, np.concatenate([pose.translation for pose in lifted]).reshape(-1, dim))
