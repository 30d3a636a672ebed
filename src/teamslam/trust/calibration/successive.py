"""What sightings that follow each other say of how they differ, where nearly all of their errors hangs together.

Errors of variance one that fade by f = exp(-dt / lasting) from one sighting of a target to the next have the
information

    P  =  1 / t  +  kappa L ,      t = (1 + f) / (1 - f) ,   kappa = f / (1 - f^2) ,   L = [1 -1; -1 1] of neighbours

exactly, but for the ends. 1 / t is what `tempering` leaves, honest for what many say together; kappa L is what two that
follow each other say of what changed between them: a camera that is 2 cm off sees its own motion to a millimetre.
Where some of the errors stays, or does not hang together at all,

    kappa  =  (1 / s - 1 / t) / 4       s: the power of errors that alternate from one to the next, t of those that last

is right for both, and says too little of what is between: 1 / P is convex in the power of differences, and that of such
errors is concave. Where much does not hang together it adds little, and is left out (`Persistence.sharp`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Names, Table
from teamslam.model.sparse import sp
from teamslam.trust.calibration.persistence import Persistence, targets_of

SURELY = 1e-2  # the share of errors' power that alternates at least: by few pairs less is not told from none
LEAST = 1e-2  # of what a row counts alone: less is not worth its place


@dataclass(frozen=True, eq=False)
class Successive:
    """Sightings that follow each other, places `one` and `other` (k,) in a table, and what they say of how they differ:
    the `root` (k, r) of kappa, part by part."""

    one: IntArray
    other: IntArray
    root: Array

    @classmethod
    def of(cls, table: Table, names: Names, held: Sequence[Persistence]) -> "Successive":
        """Those of a table whose errors hang together, part by part, as is `held`."""
        stamps, targets = names.stamps_s(table.keys[:, 0]), targets_of(table)
        order = np.lexsort((stamps, targets))
        one, other = order[:-1], order[1:]
        alike = targets[one] == targets[other]
        one, other = one[alike], other[alike]
        apart = stamps[other] - stamps[one]
        times = np.sort(stamps)
        beside = np.searchsorted(times, stamps[other], "left") - np.searchsorted(times, stamps[one], "left")
        kappa = np.stack([_kappa(each, apart, np.maximum(beside, 1)) for each in held], -1)
        kappa = np.where(kappa > LEAST, kappa, 0.0)
        worth = kappa.any(-1)
        return cls(one[worth], other[worth], np.sqrt(kappa[worth]))

    @classmethod
    def none(cls, parts: int) -> "Successive":
        """No rows that follow each other."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, parts)))

    def among(self, places: IntArray) -> "Successive":
        """The same of the rows where these stand in another table: at `places` (m,), -1 of those that are not in it."""
        one, other = places[self.one], places[self.other]
        there = (one >= 0) & (other >= 0)
        return Successive(one[there], other[there], self.root[there])

    def whitened(self, whitening: Array) -> sp.csr_array:
        """What takes errors of all rows (m r,) to how they differ, in its own deviations (k r, m r); by W of each row
        (m, r, r)."""
        k, r = self.root.shape
        both = np.stack([whitening[self.one], -whitening[self.other]], 2) * self.root[:, None, None, :]
        columns = np.stack([self.one, self.other], 1)[:, None, :, None] * r + np.arange(r)
        columns = np.broadcast_to(columns, (k, r, 2, r))
        starts = 2 * r * np.arange(k * r + 1)
        return sp.csr_array((both.ravel(), columns.ravel(), starts), shape=(k * r, len(whitening) * r))


def _kappa(held: Persistence, apart: Array, beside: Array) -> Array:
    """What two sightings of a target that follow each other, so far `apart`, say of how they differ (k,), where
    `beside` so many sightings are made in the time: what all have in common alternates in all of them at once."""
    if not held.sharp:
        return np.zeros(len(apart))
    alternates, lasts = np.full(len(apart), held.alone), np.full(len(apart), held.alone)
    for curve, many in ((held.own, np.ones(len(apart))), (held.across, beside)):
        fades = np.maximum(np.tanh(0.5 * apart / curve.lasting_s), 1e-9)
        alternates += many * curve.brief * fades
        lasts += many * (curve.brief / fades + curve.steady * len(apart))
    alternates, lasts = np.maximum(alternates, SURELY), np.maximum(lasts, SURELY)
    return np.asarray(np.maximum(0.25 * (1.0 / alternates - 1.0 / lasts), 0.0))
