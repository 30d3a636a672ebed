"""Products of a small matrix for each row with many numbers of it: as one sparse matrix, as rows come by the
thousand."""

from functools import lru_cache

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model.sparse import sp


def by_rows(matrices: Array, numbers: Array) -> Array:
    """A_i b_i (m, r, k), for A (m or 1, r, r) and b (m, r, k)."""
    m, r, draws = numbers.shape
    along = np.broadcast_to(matrices, (m, r, r)).ravel()
    whole = sp.csr_array((along, *_places(m, r)), shape=(m * r, m * r))
    return np.asarray(whole @ numbers.reshape(m * r, draws)).reshape(m, r, draws)


@lru_cache(maxsize=64)
def _places(m: int, r: int) -> tuple[IntArray, IntArray]:
    """Columns and row starts of a matrix by rows with m blocks (r, r) along its diagonal."""
    columns: IntArray = np.broadcast_to(np.arange(m * r).reshape(m, 1, r), (m, r, r)).ravel()
    return columns, np.arange(0, m * r * r + 1, r)


def inverse_of_lower(roots: Array) -> Array:
    """L_i^-1 (m, r, r) of lower triangles L."""
    out = np.zeros_like(roots)
    for j in range(roots.shape[-1]):
        out[:, j, j] = 1.0 / roots[:, j, j]
        for i in range(j + 1, roots.shape[-1]):
            out[:, i, j] = -np.sum(roots[:, i, j:i] * out[:, j:i, j], -1) / roots[:, i, i]
    return out
