"""The order of elimination of a block matrix, and every index that its factorisation needs."""

import weakref

import numpy as np
from numpy.typing import ArrayLike

from teamslam.errors import ModelError, SolveError
from teamslam.kernel.library import InKernel, floats, integers, library
from teamslam.kernel.pattern import BlockPattern

ORDERINGS = ("automatic", "minimum_degree", "nested_dissection", "geometric", "natural")


POSITIONS_HELP_FROM = 2500
"""Variables: smaller problems are ordered without regard to where things are."""


class Analysis(InKernel):
    """What factors of one pattern have in common: the order of elimination and all indices. Made once, shared freely.

    `ordering` is a name of ORDERINGS; positions (n, 3) help it from POSITIONS_HELP_FROM on. `last` names variables that
    are eliminated last, in that order, for `Factor.eliminate`.
    """

    def __init__(
        self,
        pattern: BlockPattern,
        ordering: str = "automatic",
        positions: ArrayLike | None = None,
        last: ArrayLike | None = None,
    ) -> None:
        n = len(pattern.dofs)
        if n == 0:
            raise ModelError("the pattern has no variables: there is nothing to factorise")
        if ordering not in ORDERINGS:
            raise ModelError(f"ordering: found {ordering!r}, expected one of {', '.join(ORDERINGS)}")
        places = None if positions is None else floats("positions", positions, (n, 3))
        if places is not None and not np.isfinite(places).all():
            raise ModelError("positions: found a number that is not finite")
        if ordering == "geometric" and places is None:
            raise ModelError("ordering 'geometric' needs positions")
        kept = np.zeros(0, np.int64) if last is None else integers("last", last, (None,))
        if len(kept) and (kept.min() < 0 or kept.max() >= n or len(np.unique(kept)) < len(kept)):
            raise ModelError(f"last: expected different variables from 0 to {n - 1}")
        pointer = library.analysis_new(
            n,
            pattern.dofs,
            pattern.column_start,
            pattern.row,
            ORDERINGS.index(ordering),
            places,
            kept.astype(np.int32),
            len(kept),
        )
        if not pointer:
            raise SolveError(library.error().decode())
        self.pointer: int = pointer
        weakref.finalize(self, library.analysis_free, pointer)
        self.pattern = pattern
        self.last_size = int(pattern.dofs[kept].sum())
