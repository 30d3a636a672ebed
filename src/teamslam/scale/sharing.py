"""What the parts of a team share, and in which order they are best joined.

A variable that several leaves name is a separator until all of them are joined. Leaves stand in a row and groups are
stretches of it, so of each such variable it is enough to know the first and the last leaf that names it. The narrower
the separators the smaller every join: the row is cut in two where the least is shared, each half again, and so on.
Source of the cut: Fiedler (1973), the eigenvector of the second smallest eigenvalue of the graph's Laplacian.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import AnyArray, Array, IntArray
from teamslam.model.sparse import sp

SPECTRAL = 600  # leaves up to which the cut is sought; beyond, the row is halved as it stands


@dataclass(frozen=True, eq=False)
class Sharing:
    """The variables (sorted keys) that more than one of a row of leaves names; the first and last leaf of each."""

    keys: IntArray
    first: IntArray
    last: IntArray

    @classmethod
    def of(cls, named: Sequence[IntArray]) -> "Sharing":
        """The sharing of leaves that each name some keys (unique)."""
        keys, holder = _flat(named)
        order = np.argsort(keys, kind="stable")
        keys, holder = keys[order], holder[order]
        starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
        ends = np.append(starts[1:], len(keys)) - 1
        several = ends > starts
        return cls(keys[starts[several]], holder[starts[several]], holder[ends[several]])

    def across(self, start: int, stop: int) -> IntArray:
        """The keys that leaves start to stop (stop not included) may hold and leaves outside name too."""
        touches = (self.first < stop) & (self.last >= start)
        return self.keys[touches & ((self.first < start) | (self.last >= stop))]


def by_sharing(named: Sequence[IntArray]) -> list[int]:
    """The order in which leaves stand best, from the keys that each names: those that share much are near each other.

    Halves are powers of two where they can be, so that groups of 2, 4, 8, ... neighbours fall within one half.
    """
    keys, holder = _flat(named)
    _, column = np.unique(keys, return_inverse=True)
    incidence = sp.csr_array((np.ones(len(keys)), (holder, column)), shape=(len(named), int(column.max(initial=0)) + 1))
    weights = sp.csr_array(incidence @ incidence.T)
    return _in_row(np.arange(len(named)), weights)


def _in_row(members: IntArray, weights: sp.csr_array) -> list[int]:
    from scipy.sparse.csgraph import connected_components

    if len(members) <= 2:
        return [int(m) for m in members]
    half = 1 << (len(members) - 1).bit_length() - 1
    inner = weights[members][:, members]
    count, label = connected_components(inner, directed=False)
    if count > 1:  # what shares nothing is kept together, the lowest first
        place: AnyArray = np.argsort(label, kind="stable")
    elif len(members) > SPECTRAL:
        place = np.arange(len(members))
    else:
        place = np.argsort(_fiedler(inner), kind="stable")
    near, far = np.sort(members[place[:half]]), np.sort(members[place[half:]])
    return _in_row(near, weights) + _in_row(far, weights)


def _fiedler(weights: sp.csr_array) -> Array:
    """The vector along which a connected graph is longest; rising from the side of its first node."""
    dense = weights.toarray()
    np.fill_diagonal(dense, 0.0)
    _, vectors = np.linalg.eigh(np.diag(dense.sum(0)) - dense)
    vector = np.asarray(vectors[:, 1])
    return vector if vector[0] <= 0.0 else -vector


def _flat(named: Sequence[IntArray]) -> tuple[IntArray, IntArray]:
    return np.concatenate(named), np.repeat(np.arange(len(named)), [len(keys) for keys in named])
