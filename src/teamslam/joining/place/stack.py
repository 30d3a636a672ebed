"""The variables of several submaps side by side, so that a loop over submaps is one line over arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Submap
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
    def start(self) -> IntArray:
        """Where each variable begins in the state (n,)."""
        sizes = KIND_SIZE[self.kinds]
        return np.asarray(np.cumsum(sizes) - sizes)
