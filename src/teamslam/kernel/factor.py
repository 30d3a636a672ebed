"""Sparse Cholesky factors of symmetric positive definite block matrices."""

import threading
import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from teamslam.errors import ModelError, SolveError
from teamslam.kernel.analysis import ORDERINGS, Analysis
from teamslam.kernel.library import Floats, InKernel, Integers, checked, floats, integers, library
from teamslam.kernel.pattern import BlockPattern


class NotPositiveDefinite(SolveError):
    """A pivot was not positive. `variable` is the variable of the pattern at which it was found."""

    def __init__(self, variable: int) -> None:
        self.variable = variable
        super().__init__(
            f"the matrix is not positive definite: a pivot of variable {variable} is not positive; "
            "look for what determines it"
        )


@dataclass(frozen=True)
class Statistics:
    """A factor in numbers: nonzeros of L, flops of one factorisation, bytes held, and the ordering that was used."""

    nonzeros: int
    flops: float
    bytes: int
    ordering: str


class Factor(InKernel):
    """The Cholesky factor of matrices of one pattern: analysed once, factorised as often as wanted.

    `structure` is the pattern, or an analysis of it to share. Nothing is regularised: NotPositiveDefinite names the
    variable.
    """

    def __init__(self, structure: BlockPattern | Analysis) -> None:
        analysis = structure if isinstance(structure, Analysis) else Analysis(structure)
        pointer = library.factor_new(analysis.pointer)
        if not pointer:
            raise SolveError(library.error().decode())
        self._pointer: int = pointer
        weakref.finalize(self, library.factor_free, pointer)
        self.pattern = analysis.pattern
        self._last_size = analysis.last_size
        self._lock = threading.Lock()
        self._holds = "nothing"  # or "factor", "complement"
        self._pivot = np.empty(1, np.int32)

    def factor(self, values: ArrayLike, damping: ArrayLike | None = None) -> None:
        """Factorise the matrix with `values` on the pattern, plus diag(damping) (scalars,)."""
        a, d = self._matrix(values, damping)
        with self._lock:
            self._holds = "nothing"
            checked(library.factorise(self._pointer, a, d, self._pivot))
            self._check_pivot()
            self._holds = "factor"

    def solve(self, rhs: ArrayLike) -> Floats:
        """x with A x = rhs, for rhs (scalars,) or (scalars, k)."""
        x = self._copied(rhs)
        with self._held("factor"):
            checked(library.solve(self._pointer, x, _columns_of(x)))
        return x

    def solve_lower(self, rhs: ArrayLike) -> Floats:
        """L^-1 P rhs, in elimination order: with rhs = J', its X'X is J A^-1 J'."""
        x = self._copied(rhs)
        with self._held("factor"):
            checked(library.solve_lower(self._pointer, x, _columns_of(x)))
        return x

    def solve_upper(self, rhs: ArrayLike) -> Floats:
        """P' L^-T rhs, rows of rhs in elimination order: of white noise it makes draws of covariance A^-1.

        Law: solve_upper(solve_lower(b)) is solve(b).
        """
        x = self._copied(rhs)
        with self._held("factor"):
            checked(library.solve_upper(self._pointer, x, _columns_of(x)))
        return x

    def log_determinant(self) -> float:
        """log det A."""
        with self._held("factor"):
            return float(library.log_determinant(self._pointer))

    def inverse_on_pattern(self) -> Floats:
        """The entries of A^-1 where A has entries, in the layout of its values."""
        out = np.empty(self.pattern.size)
        with self._held("factor"):
            checked(library.inverse_on_pattern(self._pointer, out))
        return out

    def diagonal_inverse(self, variables: ArrayLike | None = None) -> list[Floats]:
        """The diagonal blocks (dof, dof) of A^-1, marginal covariances: of some variables, or of all.

        Only what they depend on is computed: a few of many variables take a fraction of the time of all.
        """
        stacks = self.diagonal_inverse_by_size(variables)
        blocks: list[Floats] = [np.empty(0)] * sum(len(places) for places, _ in stacks)
        for places, stack in stacks:
            for place, block in zip(places.tolist(), stack, strict=True):
                blocks[place] = block
        return blocks

    def diagonal_inverse_by_size(self, variables: ArrayLike | None = None) -> list[tuple[Integers, Floats]]:
        """The same, blocks of one size as a stack (k, dof, dof), with the places (k,) that they have among those asked
        for."""
        n = len(self.pattern.dofs)
        wanted = np.arange(n) if variables is None else integers("variables", variables, (None,))
        if len(wanted) and (wanted.min() < 0 or wanted.max() >= n):
            raise ModelError(f"variables: found {wanted.min()} to {wanted.max()}, expected 0 to {n - 1}")
        dofs = self.pattern.dofs[wanted].astype(np.int64)
        starts = np.concatenate([[0], np.cumsum(dofs * dofs)])
        flat = np.empty(int(starts[-1]))
        with self._held("factor"):
            checked(library.diagonal_inverse(self._pointer, wanted.astype(np.int32), len(wanted), flat))
        found = []
        for d in np.unique(dofs):
            places = np.flatnonzero(dofs == d)
            found.append((places, flat[starts[places, None] + np.arange(d * d)].reshape(-1, d, d)))
        return found

    def eliminate(
        self, values: ArrayLike, rhs: ArrayLike | None = None, damping: ArrayLike | None = None
    ) -> tuple[Floats, Floats | None]:
        """The Schur complement onto `last` (m, m), and with rhs (scalars,) the right-hand side reduced with it (m,).

        complement = A_ll - A_li A_ii^-1 A_il,  reduced = b_l - A_li A_ii^-1 b_i. Raises NotPositiveDefinite where A_ii
        is not.
        """
        a, d = self._matrix(values, damping)
        if self._last_size == 0:
            raise ModelError("the factor was made without 'last' variables to eliminate onto")
        m = self._last_size
        complement = np.empty((m, m))
        b = None if rhs is None else floats("rhs", rhs, (self.pattern.scalars,))
        reduced = None if rhs is None else np.empty(m)
        with self._lock:
            self._holds = "nothing"
            checked(
                library.eliminate(
                    self._pointer,
                    a,
                    d,
                    complement,
                    b,
                    reduced,
                    self._pivot,
                )
            )
            self._check_pivot()
            self._holds = "complement"
        return complement, reduced

    def back_substitute(self, last_solution: ArrayLike, rhs: ArrayLike) -> Floats:
        """The whole solution (scalars,), from that of `last` (m,) and the right-hand side given to `eliminate`."""
        known = floats("last_solution", last_solution, (self._last_size,))
        x = floats("rhs", rhs, (self.pattern.scalars,)).copy()
        with self._held("complement"):
            checked(library.back_substitute(self._pointer, known, x))
        return x

    @property
    def order(self) -> NDArray[np.int32]:
        """The variable at each position of the elimination."""
        out = np.empty(len(self.pattern.dofs), np.int32)
        library.order(self._pointer, len(out), out)
        return out

    @property
    def statistics(self) -> Statistics:
        """The factor in numbers."""
        numbers = np.empty(4)
        library.statistics(self._pointer, numbers)
        return Statistics(int(numbers[0]), float(numbers[1]), int(numbers[2]), ORDERINGS[int(numbers[3])])

    # --- inside ---------------------------------------------------------------------------------------------------

    def _matrix(self, values: ArrayLike, damping: ArrayLike | None) -> tuple[Floats, Floats | None]:
        a = floats("values", values, (self.pattern.size,))
        return a, None if damping is None else floats("damping", damping, (self.pattern.scalars,))

    def _copied(self, rhs: ArrayLike) -> Floats:
        """A copy, row-major."""
        return floats("rhs", rhs, (self.pattern.scalars,), (self.pattern.scalars, None)).copy()

    def _check_pivot(self) -> None:
        if self._pivot[0] >= 0:
            raise NotPositiveDefinite(int(self._pivot[0]))

    def _held(self, wanted: str) -> "_Held":
        return _Held(self._lock, self, wanted)


class _Held:
    """The lock of a factor, taken only if it holds what is wanted."""

    def __init__(self, lock: threading.Lock, factor: Factor, wanted: str) -> None:
        self.lock, self.factor, self.wanted = lock, factor, wanted

    def __enter__(self) -> None:
        self.lock.acquire()
        holds = self.factor._holds
        if holds != self.wanted:
            self.lock.release()
            call = {"factor": "factor", "complement": "eliminate"}[self.wanted]
            raise SolveError(f"the factor holds {holds}; call {call} first")

    def __exit__(self, *_: object) -> None:
        self.lock.release()


def _columns_of(x: Floats) -> int:
    return 1 if x.ndim == 1 else x.shape[1]
