"""Symmetric positive definite matrices without some of their variables, eliminated exactly, the rest left sparse."""

import weakref

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teamslam.errors import ModelError
from teamslam.kernel.factor import NotPositiveDefinite
from teamslam.kernel.library import Floats, Integers, checked, floats, indices, integers, library


class Condensation:
    """H_ss - H_sb H_bb^-1 H_bs of a matrix by rows of scalars (both triangles, columns rising), over variables of
    `dofs` unknowns, of which those marked in `gone` (n,) are eliminated.

    `frugal`: what would leave more numbers than it takes away stays (cpp/condensation.hpp has the rule). `gone`, the
    attribute, says which went. Raises NotPositiveDefinite where these are not determined by the rest.
    """

    def __init__(
        self,
        dofs: ArrayLike,
        data: ArrayLike,
        columns: ArrayLike,
        start: ArrayLike,
        gone: ArrayLike,
        *,
        frugal: bool = False,
    ) -> None:
        sizes = integers("dofs", dofs, (None,))
        rows = integers("row starts", start, (int(sizes.sum()) + 1,))
        at = indices("columns", columns, int(rows[-1]))
        numbers = floats("data", data, (int(rows[-1]),))
        marked = np.array(gone, np.uint8)
        if marked.shape != sizes.shape:
            raise ModelError(f"gone: found shape {marked.shape}, expected {sizes.shape}")
        found = np.empty(3, np.int64)
        pointer = library.condensation_new(
            len(sizes), sizes.astype(np.int32), rows, at, numbers, marked, int(frugal), found
        )
        if not pointer:
            raise ModelError(library.error().decode())
        self._pointer: int = pointer
        weakref.finalize(self, library.condensation_free, pointer)
        self.gone: NDArray[np.bool_] = marked.astype(bool)
        _, size, failed = found.tolist()
        if failed >= 0:
            raise NotPositiveDefinite(failed)
        stays = sizes[~self.gone]
        self._scalars = int(stays.sum()), int(sizes.sum() - stays.sum())
        self._entries = int(2 * size - (stays**2).sum())

    def sparse_rows(self) -> tuple[Floats, NDArray[np.int32], NDArray[np.int32] | Integers]:
        """What stays, as (data, columns, row starts), both triangles, columns rising."""
        data, columns = np.empty(self._entries), np.empty(self._entries, np.int32)
        start = np.empty(self._scalars[0] + 1, np.int64)
        checked(library.condensed_rows(self._pointer, start, columns, data))
        return data, columns, start.astype(np.int32) if len(data) < 1 << 31 else start

    def follow(self, stays: ArrayLike) -> Floats:
        """-H_bb^-1 H_bs x_s: the move of what is gone that x'Hx is least with, once that of what stays is known."""
        known = floats("stays", stays, (self._scalars[0],))
        out = np.empty(self._scalars[1])
        checked(library.follow(self._pointer, known, out))
        return out
