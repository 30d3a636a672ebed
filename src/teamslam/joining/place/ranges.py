"""Ranges between robots as rods of measured length between two bodies of a truss.

A robot that hears how far another one is, knows no place of it that a rigid fit could use. But both ends are known,
each in its own body: the range's sensor at q_a in body a, its target at q_b in body b. Under frames X the rod misses by

    (z - |X_a q_a - X_b q_b|) / s ,    s^2 = s_range^2 + s_a^2 + s_b^2 + s_place^2 .

Three rods that are not in line, nor meet in one point, hold two bodies in the plane, six in space; how many assemblies
that leaves, `assemble` finds.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose
from teamslam.joining.place.motions import by_body, put, swept
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.robust_fit import PLACE_SIGMA
from teamslam.model import Table, is_pose

MOST = 120  # rods of one truss at most, evenly taken: more would not tell more of its frames


@dataclass(frozen=True, eq=False)
class Ranges:
    """Measured ranges between poses, raw: keys (n, 2) of observer and target, where the sensor sits in the observer's
    body (n, 3), the range (n,) [m] with its sigma (n,), and whether heights count (n,)."""

    keys: IntArray
    mounts: Array
    lengths: Array
    sigmas: Array
    spatial: BoolArray

    @classmethod
    def of(cls, tables: Iterable[Table]) -> "Ranges":
        """The ranges to poses among raw measurements."""
        parts = [t.select(is_pose(t.keys[:, 1]) & (t.ranks > 0)) for t in tables if t.model == "range"]
        mounts = [np.zeros(3) if t.sensor is None else t.sensor.lift(3).translation for t in parts]
        counts = [len(t) for t in parts]
        return cls(
            np.concatenate([np.zeros((0, 2), np.int64), *(t.keys for t in parts)]),
            np.repeat(np.reshape(mounts, (-1, 3)), counts, 0),
            np.concatenate([np.zeros(0), *(t.values[:, 0] for t in parts)]),
            np.concatenate(
                [np.zeros(0), *(np.broadcast_to(1.0 / np.abs(t.whitening[:, 0, 0]), len(t)) for t in parts)]
            ),
            np.repeat(np.array([t.dim == 3 for t in parts], bool), counts),
        )

    def select(self, index: AnyArray) -> "Ranges":
        """The ranges at a mask or index."""
        return Ranges(
            self.keys[index], self.mounts[index], self.lengths[index], self.sigmas[index], self.spatial[index]
        )

    def between(self, known: Sequence[IntArray]) -> Array:
        """How many ranges go between two of several sets of keys: (sets, sets), symmetric, zero on the diagonal."""
        holds = np.stack([np.isin(self.keys, keys) for keys in known]).astype(float)
        counts = holds[..., 0] @ holds[..., 1].T
        np.fill_diagonal(counts, 0.0)
        return np.asarray(counts + counts.T)


@dataclass(frozen=True, eq=False)
class Rods:
    """Rods between bodies: for each of n the bodies (2, n) and places there (2, n, d) of its ends, the length (n,), its
    sigma (n,), and how much higher in space one end is than the other (n,), which no frame in the plane changes."""

    bodies: int
    body: IntArray
    places: Array
    lengths: Array
    sigmas: Array
    rise: Array

    @classmethod
    def of(cls, ranges: Ranges, outlines: Sequence[Outline], dim: int) -> "Rods":
        """The rods that ranges make between bodies: those whose ends two different ones know by odometry."""
        known, body = Outline.beside(outlines)
        own = np.flatnonzero(known.own)
        own = own[np.argsort(known.keys[own], kind="stable")]
        if not len(own):
            return cls(len(outlines), np.zeros((2, 0), np.int64), np.zeros((2, 0, dim)), *np.zeros((3, 0)))
        at = own[np.minimum(np.searchsorted(known.keys[own], ranges.keys), len(own) - 1)]
        rows = np.flatnonzero((known.keys[at] == ranges.keys).all(1) & (body[at[:, 0]] != body[at[:, 1]]))
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(MOST, len(rows))).astype(int))]
        found, (a, b) = ranges.select(rows), at[rows].T
        eyes = known.places[a] + (known.turns[a] @ found.mounts[..., None])[..., 0]
        sigmas = np.sqrt(found.sigmas**2 + known.variances[a] + known.variances[b] + PLACE_SIGMA**2)
        rise = np.where(found.spatial & (dim == 2), (eyes - known.places[b])[:, 2], 0.0)
        ends = np.stack([eyes, known.places[b]])[..., :dim]
        return cls(len(outlines), np.stack([body[a], body[b]]), ends, found.lengths, sigmas, rise)

    @property
    def rows(self) -> int:
        """Numbers that hold the bodies together."""
        return len(self.lengths)

    def residual(self, frames: Pose) -> Array:
        """(s, n), whitened, of frames (s, bodies)."""
        _, length = self._across(frames)
        return np.asarray((self.lengths - length) / self.sigmas)

    def jacobian(self, frames: Pose, centres: Array, unit: float = 1.0) -> Array:
        """Of the residuals by the bodies' twists about `centres` (s, bodies, d), lengths in `unit`."""
        across, length = self._across(frames)
        ways = [
            by_body(swept(put(frames, body, places) - centres[:, body], unit), body, self.bodies)
            for body, places in zip(self.body, self.places, strict=True)
        ]
        direction = across / np.maximum(length, 1e-9)[..., None] / self.sigmas[:, None]
        return np.asarray(-np.einsum("snd,sndu->snu", direction, ways[0] - ways[1]))

    def _across(self, frames: Pose) -> tuple[Array, Array]:
        """From the targets to the eyes (s, n, d), and how far (s, n)."""
        across = put(frames, self.body[0], self.places[0]) - put(frames, self.body[1], self.places[1])
        return across, np.sqrt(np.sum(across**2, -1) + self.rise**2)
