"""The variables of several submaps side by side, so that a loop over submaps is one line over arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import Submap, is_pose, pack, pose_kind, robot_of
from teamslam.model.layout import KIND_SIZE


@dataclass(frozen=True, eq=False)
class Stack:
    """The variables (n,) of submaps (m,) one after another: `keys`, `kinds`, the submap (0..m) that is the `holder` of
    each, and their `state` in its frame; of each submap the key of its base and the dimension of that."""

    bases: IntArray
    base_dims: IntArray
    keys: IntArray
    kinds: IntArray
    holder: IntArray
    state: Array

    @classmethod
    def of(cls, submaps: Sequence[Submap]) -> "Stack":
        """The variables of some submaps, in their order; the bases are not among them."""
        values = [submap.values for submap in submaps]
        return cls(
            bases=np.array([submap.base for submap in submaps], np.int64),
            base_dims=np.array([submap.base_dim for submap in submaps], np.int64),
            keys=np.concatenate([v.layout.keys for v in values]),
            kinds=np.concatenate([v.layout.kinds for v in values]),
            holder=np.repeat(np.arange(len(values)), [len(v.layout.keys) for v in values]),
            state=np.concatenate([v.state for v in values]),
        )

    @cached_property
    def with_bases(self) -> "Stack":
        """The same with each submap's base before all, which is the identity in its own frame."""
        kinds = np.array([int(pose_kind(2)), int(pose_kind(3))])[self.base_dims - 2]
        identities = [pack(Pose.identity(dim)) for dim in (2, 3)]
        return Stack(
            self.bases,
            self.base_dims,
            keys=np.concatenate([self.bases, self.keys]),
            kinds=np.concatenate([kinds, self.kinds]),
            holder=np.concatenate([np.arange(len(self.bases)), self.holder]),
            state=np.concatenate([*(identities[dim - 2] for dim in self.base_dims.tolist()), self.state]),
        )

    @cached_property
    def first_poses(self) -> IntArray:
        """Of each submap (m,) the earliest pose of its base's robot (see `Submap.first_pose`)."""
        own = robot_of(self.keys) == robot_of(self.bases)[self.holder]
        own &= is_pose(self.keys) & (self.bases >= 0)[self.holder]
        first = self.bases.copy()
        np.minimum.at(first, self.holder[own], self.keys[own])
        return first

    @cached_property
    def start(self) -> IntArray:
        """Where each variable begins in the state (n,)."""
        sizes = KIND_SIZE[self.kinds]
        return np.asarray(np.cumsum(sizes) - sizes)
