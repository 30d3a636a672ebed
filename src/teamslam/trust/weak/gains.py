"""What sightings would bring that could be made: at most, for all of them at once, and exactly, for a few.

A sighting with the whitened Jacobian A adds A'A to the information. By the lemma of Woodbury, from the factor at hand,

    S = 1 + A P A'
    gain = 1/2 log det S                                    [nats] of all that is unknown
    sigma'^2 = f'P f - f'P A' S^-1 A P f                    of a weak direction f

What hangs loose altogether (N) is tied by as many ways as A N has rank. For S the covariance of what takes part is
needed: the blocks of P of both ends, and columns of P for the one that looks (`Pairs`). Without these, with B = A P F
for the weak directions F,

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


class Pairs:
    """The covariance of pairs of variables (who looks, at what), all of `unknowns` (u,), rising. Each who looks is
    solved for once."""

    def __init__(self, known: Knowledge, unknowns: IntArray) -> None:
        self.known, self.unknowns = known, unknowns
        self._columns: dict[int, Array] = {}  # (u, d) of variables by their keys

    def of(self, keys: IntArray) -> Array:
        """Of some pairs (m, 2) of alike kinds: (m, c, c), in the order of the unknowns of both."""
        ends = [self._unknowns(keys[:, end]) for end in (0, 1)]
        first, second = (self._blocks(at) for at in ends)
        self._solve(np.unique(keys[:, 0]))
        rows = np.searchsorted(self.unknowns, ends[1])
        across = np.stack([self._columns[key][at] for key, at in zip(keys[:, 0].tolist(), rows, strict=True)])
        top = np.concatenate([first, np.swapaxes(across, 1, 2)], 2)
        return np.concatenate([top, np.concatenate([across, second], 2)], 1)

    def _unknowns(self, keys: IntArray) -> IntArray:
        return self.known.values.layout.unknowns(keys).reshape(len(keys), -1)

    def _blocks(self, at: IntArray) -> Array:
        """The blocks (m, d, d) of P at unknowns (m, d)."""
        places, blocks = next(stack for stack in self.known.stacks if stack[0].shape[1] == at.shape[1])
        return blocks[np.searchsorted(places[:, 0], at[:, 0])]

    def _solve(self, keys: IntArray) -> None:
        """The columns of those that were not asked for before."""
        new = [key for key in keys.tolist() if key not in self._columns]
        if not new:
            return
        unknowns = self._unknowns(np.array(new))
        some = max(1, CHUNK // unknowns.shape[1])
        for start in range(0, len(new), some):
            own = unknowns[start : start + some]
            unit = np.zeros((self.known.values.layout.dof, own.size))
            unit[own.ravel(), np.arange(own.size)] = 1.0
            columns = self.known.spread(unit)[self.unknowns].reshape(-1, *own.shape)
            self._columns |= {key: columns[:, k].copy() for k, key in enumerate(new[start : start + some])}


def exactly(pairs: Pairs, directions: Directions, A: Array, keys: IntArray, columns: IntArray) -> tuple[Array, Array]:
    """The gain (m,) of some sightings by their `keys` (m, 2), and what each leaves of the directions (m, k)."""
    S = np.eye(A.shape[1]) + A @ pairs.of(keys) @ np.swapaxes(A, 1, 2)
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
