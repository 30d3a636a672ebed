"""Which variables there are: of which kind, in which order (by kind, then by key), and where each stands in a state
vector.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, BoolArray, IntArray, Sealed, seal


class Kind(IntEnum):
    """The kinds of variables; the numbers are those of the native kernel."""

    POSE2 = 0
    POSE3 = 1
    POINT2 = 2
    POINT3 = 3

    @property
    def dim(self) -> int:
        """Of the space it lives in."""
        return 2 + self % 2

    @property
    def is_pose(self) -> bool:
        """A pose, not a point."""
        return self < 2

    @property
    def dof(self) -> int:
        """Unknowns (tangent dimension)."""
        return int(KIND_DOF[self])

    @property
    def size(self) -> int:
        """Numbers in the state vector."""
        return int(KIND_SIZE[self])


KIND_DOF = np.array([3, 6, 2, 3])
KIND_SIZE = np.array([6, 12, 2, 3])


def pose_kind(dim: int) -> Kind:
    """POSE2 or POSE3."""
    return Kind(dim - 2)


def point_kind(dim: int) -> Kind:
    """POINT2 or POINT3."""
    return Kind(dim)


def rows_of(starts: IntArray, lengths: IntArray) -> IntArray:
    """The indices start..start+length of several stretches, one after another."""
    if len(starts) == 0:
        return np.zeros(0, np.int64)
    ends = np.cumsum(lengths)
    return np.asarray(np.arange(ends[-1]) + np.repeat(starts - (ends - lengths), lengths))


def among(keys: int | AnyArray, rising: IntArray) -> BoolArray:
    """Whether each key stands in a rising array; shape of `keys`. Quicker than `np.isin`, which sorts both."""
    keys = np.asarray(keys, np.int64)
    if not len(rising):
        return np.zeros(keys.shape, bool)
    # Column by column: observers come in rising order, which a search goes along quickly.
    at = np.minimum(np.searchsorted(rising, keys.T).T, len(rising) - 1)
    return np.asarray(rising[at] == keys)


def distinct(keys: AnyArray) -> IntArray:
    """The different ones of keys, rising, as `np.unique` has them; where they come in rising order, as the poses of a
    log do, in a fraction of its time."""
    keys = np.asarray(keys, np.int64).ravel()
    fresh = keys[np.flatnonzero(np.diff(keys, prepend=keys[:1] - 1))]
    return fresh if (fresh[1:] > fresh[:-1]).all() else np.unique(fresh)


@dataclass(frozen=True, eq=False)
class Layout(Sealed):
    """Which variables, of which kind, in which order: sorted by kind, then by key. Keys are unique."""

    keys: IntArray  # (n,)
    kinds: IntArray  # (n,)

    def __post_init__(self) -> None:
        if self.keys.shape != self.kinds.shape or self.keys.ndim != 1:
            raise ModelError(f"a layout needs keys (n,) and kinds (n,), found {self.keys.shape} and {self.kinds.shape}")
        later = (self.kinds[1:] > self.kinds[:-1]) | (
            (self.kinds[1:] == self.kinds[:-1]) & (self.keys[1:] > self.keys[:-1])
        )
        if not later.all():
            raise ModelError("a layout is sorted by kind and key; use Layout.of to make one from any order")
        if len(self.keys) > 1 and (np.diff(self._sorted) == 0).any():
            twice = int(self._sorted[:-1][np.diff(self._sorted) == 0][0])
            raise ModelError(f"variable {twice} appears as two kinds")
        seal(self, "keys", "kinds")

    @classmethod
    def of(cls, keys: AnyArray, kinds: AnyArray) -> "Layout":
        """The layout of variables given in any order, repetition allowed."""
        keys, kinds = np.asarray(keys, np.int64), np.asarray(kinds, np.int64)
        order = np.lexsort((keys, kinds))
        keys, kinds = keys[order], kinds[order]
        fresh = np.ones(len(keys), bool)
        fresh[1:] = (keys[1:] != keys[:-1]) | (kinds[1:] != kinds[:-1])
        return cls(keys[fresh], kinds[fresh])

    def __repr__(self) -> str:
        counts = ((int(np.sum(self.kinds == kind)), kind.name.lower()) for kind in Kind)
        return f"Layout({', '.join(f'{count:,} {name}' for count, name in counts if count)})"

    def __len__(self) -> int:
        return len(self.keys)

    @cached_property
    def _order(self) -> IntArray:
        return np.argsort(self.keys, kind="stable")

    @cached_property
    def _sorted(self) -> IntArray:
        return self.keys[self._order]

    @cached_property
    def dofs(self) -> IntArray:
        """Unknowns per variable (n,)."""
        return np.asarray(KIND_DOF[self.kinds])

    @cached_property
    def dof_start(self) -> IntArray:
        """First unknown of each variable, and the total: (n + 1,)."""
        return np.concatenate([[0], np.cumsum(self.dofs)])

    @cached_property
    def state_start(self) -> IntArray:
        """First number of each variable in the state vector, and the total: (n + 1,)."""
        return np.concatenate([[0], np.cumsum(KIND_SIZE[self.kinds])])

    @cached_property
    def dof(self) -> int:
        """Unknowns in all."""
        return int(self.dof_start[-1])

    def contains(self, keys: int | AnyArray) -> BoolArray:
        """True where a key is among the variables; shape of `keys`."""
        return among(keys, self._sorted)

    def index(self, keys: int | AnyArray) -> IntArray:
        """The places of keys in the layout, shape of `keys`. Raises ModelError for a key that is not there."""
        keys = np.asarray(keys, np.int64)
        if keys.size == 0:
            return np.zeros(keys.shape, np.int64)
        # Column by column: observers come in rising order, which a search goes along quickly.
        at = np.minimum(np.searchsorted(self._sorted, keys.T).T, max(len(self) - 1, 0))
        there = self._sorted[at] == keys if len(self) else np.zeros(keys.shape, bool)
        if not there.all():
            raise ModelError(f"variable {int(keys[~there].flat[0])} is not among the {len(self)} of this layout")
        return np.asarray(self._order[at])

    def unknowns(self, keys: AnyArray) -> IntArray:
        """The unknowns (columns of the tangent) of some variables, in the order of `keys`."""
        at = self.index(keys).ravel()
        return rows_of(self.dof_start[at], self.dofs[at])

    @cached_property
    def _bounds(self) -> list[int]:
        return [int(place) for place in np.searchsorted(self.kinds, np.arange(len(Kind) + 1))]

    def stretch(self, kind: Kind) -> slice:
        """The places of all variables of one kind."""
        return slice(self._bounds[kind], self._bounds[kind + 1])

    def keys_of(self, kind: Kind) -> IntArray:
        """The keys of one kind, rising."""
        return self.keys[self.stretch(kind)]

    def select(self, mask: BoolArray) -> "Layout":
        """The layout of the variables where mask (n,) is true."""
        part = Layout.__new__(Layout)  # in order and unique as the whole is
        part.__dict__.update(keys=self.keys[mask], kinds=self.kinds[mask])
        seal(part, "keys", "kinds")
        return part

    def union(self, *others: "Layout") -> "Layout":
        """All variables of several layouts. Raises ModelError where one key has two kinds."""
        layouts = (self, *others)
        return Layout.of(np.concatenate([x.keys for x in layouts]), np.concatenate([x.kinds for x in layouts]))
