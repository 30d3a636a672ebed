"""Chains: submaps of one robot chained by boundary poses, so that their frames compose.

The first pose of submap i stands in an earlier submap p(i) of its robot as Z_p, and in its own as Z_i, hence
X_i = X_p(i) @ Z_p @ Z_i^-1. All products along all chains are formed together, each round doubling how far up they
reach.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import IntArray, Pose
from teamslam.joining.place.stack import Stack
from teamslam.model import Submap, pose_kind, robot_of, unpack


def chains_of(submaps: Sequence[Submap]) -> list[tuple[list[int], list[Pose]]]:
    """Each chain as places in the list, in an order in which every first pose but the first one's is known before, and
    the poses of the bases in the frame of the first."""
    stack = Stack.of(submaps)
    order = np.argsort(stack.bases, kind="stable")
    rank = np.argsort(order, kind="stable")
    parent, above, own = _links(stack, rank)
    roots, frames = np.arange(len(submaps)), [Pose.identity(2)] * len(submaps)
    for dim in np.unique(stack.base_dims).tolist():
        rows = np.flatnonzero(stack.base_dims == dim)
        roots[rows], poses = _composed(stack, rows, parent, (above, own), dim)
        for row, pose in zip(rows.tolist(), map(Pose, poses.rotation, poses.translation), strict=True):
            frames[row] = pose
    chains: dict[int, list[int]] = {}
    for number, root in zip(order.tolist(), roots[order].tolist(), strict=True):
        chains.setdefault(root, []).append(number)
    return [(members, [frames[number] for number in members]) for members in chains.values()]


def _links(stack: Stack, rank: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """For each submap (m,) the first one by `rank` (m,) that holds its first pose among its own robot's, or -1; and the
    rows of the stack with its bases where that one has the pose, and where it has it itself."""
    whole = stack.with_bases
    own = np.flatnonzero(
        (robot_of(whole.keys) == robot_of(stack.bases)[whole.holder]) & (stack.bases >= 0)[whole.holder]
    )
    own = own[np.argsort(rank[whole.holder[own]], kind="stable")]
    keys, holders = whole.keys[own], whole.holder[own]
    known, first = np.unique(keys, return_index=True)
    nobody = np.full(len(stack.bases), -1)
    if not len(known):
        return nobody, nobody, nobody
    at = np.minimum(np.searchsorted(known, stack.first_poses), len(known) - 1)
    holder, row = holders[first[at]], own[first[at]]
    mine = np.flatnonzero(keys == stack.first_poses[holders])
    itself = nobody.copy()
    itself[holders[mine]] = own[mine]
    held = (known[at] == stack.first_poses) & (rank[holder] < rank)
    return np.where(held, holder, -1), np.where(held, row, -1), itself


def _composed(
    stack: Stack, rows: IntArray, parent: IntArray, ends: tuple[IntArray, IntArray], dim: int
) -> tuple[IntArray, Pose]:
    """Of the submaps in `rows`, all of one dimension: the roots of their chains, and their frames there."""
    place = np.full(len(parent), -1)
    place[rows] = np.arange(len(rows))
    up = np.where(parent[rows] >= 0, place[parent[rows]], -1)
    poses = Pose.identity(dim, (len(rows),))
    rotation, translation = poses.rotation.copy(), poses.translation.copy()
    below, kind = np.flatnonzero(up >= 0), pose_kind(dim)
    whole = stack.with_bases
    there, here = (unpack(whole.state[whole.start[of[rows[below]], None] + np.arange(kind.size)], kind) for of in ends)
    assert isinstance(there, Pose) and isinstance(here, Pose)
    steps = there @ here.inverse()
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
