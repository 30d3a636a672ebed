"""What sightings would bring that could be made: at most, for all of them at once, and exactly, for a few.

A sighting with the whitened Jacobian A adds A'A to the information. By the lemma of Woodbury, from the factor at hand,

    S = 1 + A P A'
    gain = 1/2 log det S                                    [nats] of all that is unknown
    sigma'^2 = f'P f - f'P A' S^-1 A P f                    of a weak direction f

What hangs loose altogether (N) is tied by as many ways as A N has rank. For S the covariance of what takes part is
needed, columns of P. Without it, with B = A P F for the weak directions F,

    S >= 1 + B (F'P F)^-1 B'

so that none of these is firmed up by more than that says: no better than by a sighting of the directions themselves.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Table
from teamslam.solver import linearise_numerically
from teamslam.trust.weak.eyes import Eye
from teamslam.trust.weak.knowledge import Knowledge
from teamslam.trust.weak.weakest import Weak

CHUNK = 64  # columns of the covariance at a time
TIES = 1e-6
LEAST = 1e-9  # of a variance: what is left of it at least


@dataclass(frozen=True, eq=False)
class Hopes:
    """Sightings of one sensor that could be made, as `rows` (m,) of `table`, with their Jacobians A (m, r, c) over the
    unknowns `columns` (m, c). Of each: how many `ties` (m,); by how much it `firms` (m,) the weak directions at most
    (the sum of log(before / after))."""

    eye: Eye
    table: Table
    rows: IntArray
    A: Array
    columns: IntArray
    ties: IntArray
    firms: Array


@dataclass(frozen=True, eq=False)
class Directions:
    """The weak directions of a map: P F (dof, k), and F'P F (k, k)."""

    spread: Array
    together: Array

    @classmethod
    def of(cls, weak: Weak) -> "Directions":
        """Those that were told."""
        functions = [direction.hinge.function for direction in weak.directions]
        F = np.stack(functions, 1) if functions else np.zeros((weak.known.values.layout.dof, 0))
        spread = weak.known.spread(F)
        return cls(spread, F.T @ spread)

    @property
    def variances(self) -> Array:
        """Of each (k,)."""
        return np.diagonal(self.together)


def hopes_of(known: Knowledge, directions: Directions, eye: Eye, table: Table) -> Iterator[Hopes]:
    """What the rows of a table would bring at most."""
    layout = known.values.layout
    for group in linearise_numerically(table, known.values):
        columns = np.stack([layout.unknowns(pair) for pair in table.keys[group.rows]])
        A = group.jacobian
        loose = A @ known.unknown[columns] * (1.0 / max(1.0, float(np.abs(A).max(initial=0.0))))
        ties = np.linalg.matrix_rank(loose, tol=TIES) if loose.shape[-1] else np.zeros(len(A), np.int64)
        firms = _firms_at_most(directions, A @ directions.spread[columns])
        yield Hopes(eye, table, group.rows, A, columns, np.asarray(ties), firms)


def _firms_at_most(directions: Directions, b: Array) -> Array:
    """From b = A P F (m, r, k)."""
    least = np.eye(b.shape[1]) + b @ np.linalg.pinv(directions.together) @ np.swapaxes(b, 1, 2)
    after = after_of(directions, least, b)
    return np.asarray(np.sum(np.log(np.sqrt(directions.variances) / after), -1))


def after_of(directions: Directions, S: Array, b: Array) -> Array:
    """The standard deviations (m, k) of the directions once a sighting with S (m, r, r) and A P F = b (m, r, k) is
    made."""
    gone = np.sum(b * np.linalg.solve(S, b), 1)
    return np.asarray(np.sqrt(np.maximum(directions.variances - gone, LEAST * directions.variances)))


def exactly(known: Knowledge, directions: Directions, A: Array, columns: IntArray) -> tuple[Array, Array]:
    """The gain (m,) of some sightings, and what each leaves of the directions (m, k)."""
    unknowns, at = np.unique(columns, return_inverse=True)
    at = at.reshape(columns.shape)
    covariance = joint(known, unknowns)
    S = np.eye(A.shape[1]) + A @ covariance[at[:, :, None], at[:, None, :]] @ np.swapaxes(A, 1, 2)
    return np.asarray(0.5 * np.linalg.slogdet(S)[1]), after_of(directions, S, A @ directions.spread[columns])


def joint(known: Knowledge, unknowns: IntArray) -> Array:
    """The covariance of some unknowns (c, c), by and by."""
    out = np.empty((len(unknowns), len(unknowns)))
    for start in range(0, len(unknowns), CHUNK):
        chosen = unknowns[start : start + CHUNK]
        unit = np.zeros((known.values.layout.dof, len(chosen)))
        unit[chosen, np.arange(len(chosen))] = 1.0
        out[:, start : start + CHUNK] = known.spread(unit)[unknowns]
    return out
