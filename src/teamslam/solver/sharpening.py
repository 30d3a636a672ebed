"""A start for where sharp measurements leave but a narrow valley: all count as blunt first, then sharper and sharper.

A sigma of a micron beside one of metres is a constraint. From a start that breaks it a search falls into a valley a
micron wide, and creeps along its bends. Where nothing counts as sharper than `cap` the valley is wide and nearly
straight, and its bottom leads on to that of the next:

    W  ->  U min(S, cap) V'      of all whitening matrices W = U S V', and of the roots of submaps' information
    cap =  10, 100, 1000, ...    times the bluntest singular value of all

One solve of a few steps for each factor of ten between the bluntest and the sharpest (Allgower & Georg, "Introduction
to Numerical Continuation Methods", 2003, ch. 1).
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.model import Values
from teamslam.model.sparse import sp
from teamslam.solver.optimise import Options, optimise
from teamslam.solver.system import SubmapTerm, System

TENFOLD = 10.0  # sharper with every solve
FEW = 60  # iterations of each at most
ROUGH = 0.1  # [sigmas] from its optimum
NOTHING = 1e-12  # of the sharpest: no direction that is measured
DENSE = 400  # unknowns: the roots of larger submaps are not made, and there is no such start


def sharpened_start(system: System, start: Values, options: Options) -> Values | None:
    """Where the optima of a system lead from `start`, in which measurements count as sharper and sharper; None where
    all are about as sharp, or a submap is too large."""
    roots = _roots(system.submaps)
    if roots is None:
        return None
    tables = [_Spectrum.of(table.whitening) for table in system.tables]
    sharpness = np.concatenate([spectrum.sizes.ravel() for spectrum in (*tables, *roots)])
    sharpest = float(sharpness.max(initial=0.0))
    cap = TENFOLD * float(sharpness[sharpness > NOTHING * sharpest].min(initial=sharpest))
    if not cap < sharpest:
        return None
    rough = replace(options, max_iterations=min(options.max_iterations, FEW), decrement=max(options.decrement, ROUGH))
    values = start
    while cap < sharpest:
        with suppress(SolveError):  # a guess stays a guess
            values = optimise(_blunted(system, tables, roots, cap), values, rough).values
        cap *= TENFOLD
    return values


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """W = U S V' (.., m, n), found once for all caps."""

    left: Array
    sizes: Array
    right: Array

    @classmethod
    def of(cls, whitening: Array) -> "_Spectrum":
        """That of whitening matrices."""
        return cls(*np.linalg.svd(whitening, full_matrices=False))

    def capped(self, cap: float) -> Array:
        """W with its singular values held to a cap."""
        return np.asarray((self.left * np.minimum(self.sizes, cap)[..., None, :]) @ self.right)


def _roots(terms: Sequence[SubmapTerm]) -> list[_Spectrum] | None:
    """W with W'W the information of each submap, whose singular values are good where those of the information have
    long been rounded away."""
    if any(term.values.layout.dof > DENSE for term in terms):
        return None
    try:
        return [_Spectrum.of(np.linalg.cholesky(term.information.toarray()).T) for term in terms]
    except np.linalg.LinAlgError:
        return None


def _blunted(system: System, tables: Sequence[_Spectrum], roots: Sequence[_Spectrum], cap: float) -> System:
    """The same problem in which nothing is measured sharper than `cap`."""
    terms = []
    for term, root in zip(system.submaps, roots, strict=True):
        blunt = root.capped(cap)
        terms.append(replace(term, information=sp.csr_array(blunt.T @ blunt)))
    blunted = [replace(t, whitening=of.capped(cap)) for t, of in zip(system.tables, tables, strict=True)]
    return system.alike(blunted, terms)
