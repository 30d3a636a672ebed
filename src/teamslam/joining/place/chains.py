"""Chains: submaps of one robot chained by boundary poses, so that their frames compose.

The base of submap i stands in an earlier submap p(i) of its robot as the pose Z_i, hence X_i = X_p(i) @ Z_i. All
products along all chains are formed together, each round doubling how far up they reach.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import IntArray, Pose
from teamslam.joining.place.stack import Stack
from teamslam.model import Submap, pose_kind, robot_of, unpack


def chains_of(submaps: Sequence[Submap]) -> list[tuple[list[int], list[Pose]]]:
    """Each chain as places in the list, in an order in which every base but the first is known before, and the poses
    of the bases in the frame of the first."""
    stack = Stack.of(submaps)
    order = np.argsort(stack.bases, kind="stable")
    holder, start = _holders(stack)
    rank = np.argsort(order, kind="stable")
    parent = np.where((holder >= 0) & (rank[holder] < rank), holder, -1)
    roots, frames = np.arange(len(submaps)), [Pose.identity(2)] * len(submaps)
    for dim in np.unique(stack.base_dims).tolist():
        rows = np.flatnonzero(stack.base_dims == dim)
        roots[rows], poses = _composed(stack, rows, parent, start, dim)
        for row, pose in zip(rows.tolist(), map(Pose, poses.rotation, poses.translation), strict=True):
            frames[row] = pose
    chains: dict[int, list[int]] = {}
    for number, root in zip(order.tolist(), roots[order].tolist(), strict=True):
        chains.setdefault(root, []).append(number)
    return [(members, [frames[number] for number in members]) for members in chains.values()]


def _composed(stack: Stack, rows: IntArray, parent: IntArray, start: IntArray, dim: int) -> tuple[IntArray, Pose]:
    """Of the submaps in `rows`, all of one dimension: the roots of their chains, and their frames there."""
    place = np.full(len(parent), -1)
    place[rows] = np.arange(len(rows))
    up = np.where(parent[rows] >= 0, place[parent[rows]], -1)
    poses = Pose.identity(dim, (len(rows),))
    rotation, translation = poses.rotation.copy(), poses.translation.copy()
    below, kind = np.flatnonzero(up >= 0), pose_kind(dim)
    steps = unpack(stack.state[start[rows[below], None] + np.arange(kind.size)], kind)
    assert isinstance(steps, Pose)
    rotation[below], translation[below] = steps.rotation, steps.translation
    root = np.arange(len(rows))
    while len(below):
        above = up[below]
        composed = Pose(rotation[above], translation[above]) @ Pose(rotation[below], translation[below])
        rotation[below], translation[below], root[below], up[below] = (
            composed.rotation, composed.translation, root[above], up[above],
        )  # fmt: skip
        below = np.flatnonzero(up >= 0)
    return rows[root], Pose(rotation, translation)


def _holders(stack: Stack) -> tuple[IntArray, IntArray]:
    """For each submap the first one that holds its base among its own robot's poses, or -1; and where that pose begins
    in the stack's state."""
    own = np.flatnonzero(robot_of(stack.keys) == robot_of(stack.bases)[stack.holder])
    known, first = np.unique(stack.keys[own], return_index=True)
    if not len(known):
        return np.full(len(stack.bases), -1), np.full(len(stack.bases), -1)
    at = np.minimum(np.searchsorted(known, stack.bases), len(known) - 1)
    there = own[first[at]]
    held = known[at] == stack.bases
    return np.where(held, stack.holder[there], -1), np.where(held, stack.start[there], -1)
