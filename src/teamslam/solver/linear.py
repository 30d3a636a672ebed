"""The one seam to sparse algebra: symmetric block matrices, factorised by the native kernel.

A `Matrix` is a pattern of blocks with numbers. `Factor` analyses a pattern once and factorises as often as asked:
solutions, marginal covariances, Schur complements. A pivot that is not positive is an error that names the variable;
nothing is regularised in silence.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from teamslam import kernel
from teamslam.errors import SolveError
from teamslam.geometry import Array, IntArray
from teamslam.model import Layout, Names, Values
from teamslam.model.sparse import sp


@dataclass(frozen=True, eq=False)
class Matrix:
    """A symmetric matrix of blocks: the kernel's pattern and its numbers (lower triangle, block by block).

    `analysis` is that of the pattern, where one was made already; factors of the matrix then share it.
    """

    pattern: kernel.BlockPattern
    numbers: Array
    analysis: kernel.Analysis | None = None

    def __repr__(self) -> str:
        return f"Matrix({self.pattern.scalars:,} unknowns, {len(self.numbers):,} numbers)"

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"analysis": None}  # which lives in the kernel

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
    rows = by_rising_columns(matrix)
    return kernel.BlockPattern.of_sparse_rows(layout.dofs, rows.data, rows.indices, rows.indptr)


def by_rising_columns(matrix: sp.csr_array) -> sp.csr_array:
    """The same matrix with each row's columns rising and none twice; itself where it is so already."""
    if matrix.has_canonical_format:
        return matrix
    rising = matrix.copy()
    rising.sum_duplicates()
    return rising


def analysis_of(layout: Layout, pattern: kernel.BlockPattern, values: Values | None) -> kernel.Analysis:
    """The analysis of a pattern over the unknowns of `layout`, for which positions in `values` help where it is
    large."""
    helps = values is not None and len(layout) >= kernel.POSITIONS_HELP_FROM
    return kernel.Analysis(
        pattern, positions=values.positions(layout.keys, 3) if values is not None and helps else None
    )


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
        self._structure, self._factor = structure, kernel.Factor(structure)
        self._numbers: Array | None = None
        self._damping: Array | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What travels: what was factorised, to be factorised again. TypeError where some are eliminated last."""
        if self._structure.last_size or self._numbers is None:
            raise TypeError(
                "a factor that keeps variables for last, or holds no matrix yet, cannot be copied or pickled"
            )
        return {
            "layout": self.layout,
            "names": self.names,
            "pattern": self._structure.pattern,
            "numbers": self._numbers,
            "damping": self._damping,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["layout"], state["pattern"], names=state["names"])  # type: ignore[misc]
        self.factorise(state["numbers"], state["damping"])

    @classmethod
    def of(
        cls,
        layout: Layout,
        matrix: Matrix | sp.csr_array,
        names: Names | None = None,
        values: Values | None = None,
    ) -> "Factor":
        """The factor of one matrix; the positions in `values` help to find a good order of elimination. Raises
        SolveError where it is not positive definite."""
        blocks = matrix if isinstance(matrix, Matrix) else Matrix(*block_matrix(layout, matrix))
        factor = cls(layout, blocks.analysis or analysis_of(layout, blocks.pattern, values), names=names)
        factor.factorise(blocks.numbers)
        return factor

    def factorise(self, numbers: Array, damping: Array | None = None) -> None:
        """Factorise H + diag(damping). Raises SolveError naming the variable where H is not positive definite."""
        self._numbers, self._damping = numbers, damping
        try:
            self._factor.factor(numbers, damping)
        except kernel.NotPositiveDefinite as problem:
            key = int(self.layout.keys[problem.variable])
            raise SolveError(
                f"{self.names.describe(key)} is not determined, to within rounding: the information matrix has no "
                f"positive pivot there; look for what observes it, which may be too little, or numbers that contradict "
                f"each other, or whose sigmas are very far apart (`teamslam info` looks for such)",
                key=key,
            ) from None

    def solve(self, right: Array) -> Array:
        """H^-1 right, right (n,) or (n, k)."""
        return np.asarray(self._factor.solve(right))

    def half(self, right: Array) -> Array:
        """L^-1 right, in the order of elimination, for L L' = H and right (n,) or (n, k). Law: half(J')' half(J') is
        J H^-1 J', and draws(half(right)) is solve(right)."""
        return np.asarray(self._factor.solve_lower(right))

    def log_determinant(self) -> float:
        """log det H."""
        return self._factor.log_determinant()

    def draws(self, white: Array) -> Array:
        """H^-1/2 white, white (n,) or (n, k): columns of white noise become draws whose covariance is H^-1."""
        return np.asarray(self._factor.solve_upper(white))

    def marginals(self, places: IntArray | None = None) -> list[Array]:
        """The marginal covariances of the variables at some places of the layout, or of all in its order."""
        return self._factor.diagonal_inverse(places)

    def marginals_by_size(self) -> list[tuple[IntArray, Array]]:
        """The marginal covariances of all variables, those of one size as a stack (k, dof, dof), with their places (k,)
        in the layout."""
        return self._factor.diagonal_inverse_by_size()

    def information_of(self, places: IntArray) -> Array:
        """The information of the variables at some places of the layout, rising, when all others are eliminated: dense,
        the inverse of their joint covariance."""
        assert self._numbers is not None, "the factor holds no matrix yet"
        last = Factor(self.layout, self._structure.pattern, last=places, names=self.names)
        return last.eliminate(self._numbers, np.zeros(self.layout.dof))[0]

    def in_sigmas(self, shift: Array) -> Array:
        """How far a shift (dof,) moves each variable (n,), in its own standard deviations."""
        return in_sigmas(shift, self.layout, self.marginals_by_size())

    def eliminate(self, numbers: Array, right: Array) -> tuple[Array, Array]:
        """The Schur complement of H onto `last`, dense, and the right-hand side reduced with it.

        Raises SolveError where what is eliminated is not determined once `last` is given.
        """
        try:
            complement, reduced = self._factor.eliminate(numbers, right)
        except kernel.NotPositiveDefinite as problem:
            key = int(self.layout.keys[problem.variable])
            raise SolveError(
                f"{self.names.describe(key)} is not determined by the rest of its submap", key=key
            ) from None
        return np.asarray(complement), np.asarray(reduced)

    def back_substitute(self, last: Array, right: Array) -> Array:
        """The whole solution, once that of the `last` variables is known; `right` as given to `eliminate`."""
        return np.asarray(self._factor.back_substitute(last, right))


def in_sigmas(shift: Array, layout: Layout, marginals: list[tuple[IntArray, Array]]) -> Array:
    """How far a shift (dof,) moves each variable (n,) of a layout, in its own standard deviations by `marginals` (see
    `Factor.marginals_by_size`): sqrt(d_v' P_vv^-1 d_v)."""
    out = np.zeros(len(layout))
    for places, blocks in marginals:
        moved = shift[layout.dof_start[places, None] + np.arange(blocks.shape[-1])]
        out[places] = np.sqrt(np.sum(moved * np.linalg.solve(blocks, moved[..., None])[..., 0], -1))
    return out
