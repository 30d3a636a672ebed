"""An information matrix without some of its variables, exactly, and their estimate once the rest has moved.

    I = [I_ss I_sb; I_bs I_bb]      s: stay, b: gone

    information    Lambda = I_ss - I_sb I_bb^-1 I_bs     what is known of s, whatever b may be
    follow         d_b = -I_bb^-1 I_bs d_s               where b goes when s moves by d_s

Variables that are gone and do not touch each other are eliminated apart from each other, so only what each group of
them connects fills in (cpp/condensation.hpp).
"""

from functools import cached_property

from teamslam import kernel
from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray
from teamslam.model import Layout, Names
from teamslam.model.sparse import sp
from teamslam.solver.linear import by_rising_columns


class Condensed:
    """A matrix over the unknowns of `layout` without the variables marked in `gone` (n,).

    `frugal`: what would leave more numbers than it takes away stays; `gone`, the attribute, says what went. Raises
    SolveError, naming the variable, where these are not determined by the rest.
    """

    def __init__(
        self, layout: Layout, matrix: sp.csr_array, gone: BoolArray, *, frugal: bool = False, names: Names | None = None
    ) -> None:
        rows = by_rising_columns(matrix)
        try:
            self._condensation = kernel.Condensation(
                layout.dofs, rows.data, rows.indices, rows.indptr, gone, frugal=frugal
            )
        except kernel.NotPositiveDefinite as problem:
            key = int(layout.keys[problem.variable])
            raise SolveError(
                f"{(names or Names()).describe(key)} is not determined by the rest of its submap"
            ) from None
        self.gone: BoolArray = self._condensation.gone
        self.layout = layout.select(~self.gone)

    @cached_property
    def information(self) -> sp.csr_array:
        """What is left, over the unknowns of what stays (its `layout`)."""
        return sp.csr_array(self._condensation.sparse_rows(), shape=(self.layout.dof, self.layout.dof))

    def follow(self, shift: Array) -> Array:
        """How what is gone moves, over its unknowns, when what stays moves by `shift` (layout.dof,)."""
        return self._condensation.follow(shift)
