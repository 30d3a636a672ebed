"""The one seam to sparse algebra: symmetric block matrices, factorised by the native kernel.

A `Matrix` is a pattern of blocks with numbers. `Factor` analyses a pattern once and factorises as often as asked:
solutions, marginal covariances, Schur complements. A pivot that is not positive is an error that names the variable;
nothing is regularised in silence.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from teamslam import kernel
from teamslam.errors import SolveError
from teamslam.geometry import Array, IntArray
from teamslam.model import Layout, Names


@dataclass(frozen=True, eq=False)
class Matrix:
    """A symmetric matrix of blocks: the kernel's pattern and its numbers (lower triangle, block by block).

    `analysis` is that of the pattern, where one was made already; factors of the matrix then share it.
    """

    pattern: kernel.BlockPattern
    numbers: Array
    analysis: kernel.Analysis | None = None

    def to_csr(self) -> sp.csr_array:
        """The whole matrix, both triangles."""
        n = self.pattern.scalars
        return sp.csr_array(self.pattern.sparse_rows(self.numbers), shape=(n, n))

    def diagonal(self) -> Array:
        """The scalar diagonal."""
        first = self.pattern.value_start[self.pattern.column_start[:-1]]
        dofs = np.asarray(self.pattern.dofs, np.int64)
        within = np.arange(self.pattern.scalars) - np.repeat(self.pattern.scalar_start[:-1], dofs)
        return np.asarray(self.numbers[np.repeat(first, dofs) + within * np.repeat(dofs + 1, dofs)])


def block_matrix(layout: Layout, matrix: sp.csr_array) -> tuple[kernel.BlockPattern, Array]:
    """A symmetric sparse matrix over the unknowns of a layout, as the kernel's pattern and numbers."""
    coo = sp.coo_array(matrix)
    of_unknown = np.repeat(np.arange(len(layout)), layout.dofs)
    block_row, block_column = of_unknown[coo.row], of_unknown[coo.col]
    lower = block_row >= block_column
    row, column = coo.row[lower], coo.col[lower]
    block_row, block_column = block_row[lower], block_column[lower]
    n = len(layout)
    diagonal = np.arange(n, dtype=np.int64) * (n + 1)
    code = block_column.astype(np.int64) * n + block_row
    codes = np.unique(np.concatenate([code, diagonal]))
    pattern = kernel.BlockPattern(
        dofs=layout.dofs.astype(np.int32),
        column_start=np.searchsorted(codes, np.arange(n + 1, dtype=np.int64) * n).astype(np.int64),
        row=(codes % n).astype(np.int32) if n else np.zeros(0, np.int32),
    )
    sizes = layout.dofs[codes % n] * layout.dofs[codes // n] if n else np.zeros(0, np.int64)
    starts = np.cumsum(sizes) - sizes
    numbers = np.zeros(int(sizes.sum()))
    block = np.searchsorted(codes, code)
    height = layout.dofs[block_row]
    place = starts[block] + (row - layout.dof_start[block_row]) + (column - layout.dof_start[block_column]) * height
    numbers[place] = coo.data[lower]
    return pattern, numbers


class Factor:
    """The Cholesky factor of matrices of one pattern over the unknowns of `layout`.

    `structure` is the pattern, or an analysis of it to share. `last` names variables (places in the layout) that are
    eliminated last, for `eliminate`.
    """

    def __init__(
        self,
        layout: Layout,
        structure: kernel.BlockPattern | kernel.Analysis,
        *,
        last: IntArray | None = None,
        names: Names | None = None,
    ) -> None:
        self.layout, self.names = layout, names or Names()
        if isinstance(structure, kernel.BlockPattern):
            structure = kernel.Analysis(structure, last=last)
        self._factor = kernel.Factor(structure)

    @classmethod
    def of(cls, layout: Layout, matrix: Matrix | sp.csr_array, names: Names | None = None) -> "Factor":
        """The factor of one matrix. Raises SolveError where it is not positive definite."""
        blocks = matrix if isinstance(matrix, Matrix) else Matrix(*block_matrix(layout, matrix))
        factor = cls(layout, blocks.analysis or blocks.pattern, names=names)
        factor.factorise(blocks.numbers)
        return factor

    def factorise(self, numbers: Array, damping: Array | None = None) -> None:
        """Factorise H + diag(damping). Raises SolveError naming the variable where H is not positive definite."""
        try:
            self._factor.factor(numbers, damping)
        except kernel.NotPositiveDefinite as problem:
            key = int(self.layout.keys[problem.variable])
            raise SolveError(
                f"{self.names.describe(key)} is not determined by the measurements: the information matrix has no "
                f"positive pivot there; look for what observes it (too few sightings, or a part that nothing connects)"
            ) from None

    def solve(self, right: Array) -> Array:
        """H^-1 right, right (n,) or (n, k)."""
        return np.asarray(self._factor.solve(right))

    def draws(self, white: Array) -> Array:
        """H^-1/2 white, white (n,) or (n, k): columns of white noise become draws whose covariance is H^-1."""
        return np.asarray(self._factor.solve_upper(white))

    def marginals(self, places: IntArray | None = None) -> list[Array]:
        """The marginal covariances of the variables at some places of the layout, or of all in its order."""
        return self._factor.diagonal_inverse(places)

    def eliminate(self, numbers: Array, right: Array) -> tuple[Array, Array]:
        """The Schur complement of H onto `last`, dense, and the right-hand side reduced with it.

        Raises SolveError where what is eliminated is not determined once `last` is given.
        """
        try:
            complement, reduced = self._factor.eliminate(numbers, right)
        except kernel.NotPositiveDefinite as problem:
            key = int(self.layout.keys[problem.variable])
            raise SolveError(f"{self.names.describe(key)} is not determined by the rest of its submap") from None
        return np.asarray(complement), np.asarray(reduced)

    def back_substitute(self, last: Array, right: Array) -> Array:
        """The whole solution, once that of the `last` variables is known; `right` as given to `eliminate`."""
        return np.asarray(self._factor.back_substitute(last, right))
