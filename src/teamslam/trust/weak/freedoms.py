"""What is not held at all: for each body that hangs loose, in how many ways, and about what it moves.

A body is set against the one that leaves it the fewest freedoms: of three links of a chain the last hangs on the middle
one. The freedoms of one against another are the rank of the motions (t, w) between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.trust.weak.hinges import Hinge, hinge_of, relative
from teamslam.trust.weak.knowledge import Knowledge
from teamslam.trust.weak.parts import bodies

RANK = 1e-6


@dataclass(frozen=True, eq=False)
class Freedom:
    """A `part` (n,) of the variables that the measurements do not hold `against` another, in `ways` of `all_ways` that
    it could move. `hinge`: the freedom itself, where it is one; `centre`: the key of what all of them turn about, if
    they do."""

    part: BoolArray
    against: BoolArray
    ways: int
    all_ways: int
    hinge: Hinge | None
    centre: int | None


def freedoms(known: Knowledge) -> list[Freedom]:
    """Every body that hangs loose, the largest first."""
    if not known.unknown.shape[1]:
        return []
    found = bodies(known.motions, known.unknown)
    if not known.frame.shape[1]:  # in the world, it is the world that all hang on
        nothing = np.zeros(len(known.values), bool)
        return [f for body in found if (f := _freedom(known, body, nothing)).ways]
    return [_loosest(known, body, [o for o in found if o is not body]) for body in found[1:]]


def _loosest(known: Knowledge, body: BoolArray, others: Sequence[BoolArray]) -> Freedom:
    """A body against the other that holds it most, of several the largest."""
    return min((_freedom(known, body, other) for other in others), key=lambda f: (f.ways, -int(f.against.sum())))


def _freedom(known: Knowledge, body: BoolArray, other: BoolArray) -> Freedom:
    return _told(known, body, other, relative(known.motions, body, other) @ known.unknown)


def _told(known: Knowledge, body: BoolArray, other: BoolArray, motion: Array) -> Freedom:
    """`motion` (m, q): of the body against the other, about its middle, in each open displacement."""
    motions, d = known.motions, known.motions.dim
    scaled = motion.copy()
    scaled[d:] *= motions.lever
    u, singular, vt = np.linalg.svd(scaled, full_matrices=False)
    open_size = float(np.abs(known.unknown).max()) * max(1.0, motions.lever)
    ways = int(np.sum(singular > RANK * open_size))
    everything = _ways_of(known, body)
    if ways == 1:
        hinge = hinge_of(motions, body, other, known.unknown @ vt[0])
        return Freedom(body, other, 1, everything, hinge, None)
    return Freedom(body, other, ways, everything, None, _common_centre(known, body, other, u[:, :ways]))


def _ways_of(known: Knowledge, body: BoolArray) -> int:
    """In how many ways a body could move: a pose as a frame does, points as far as they show it."""
    motions = known.motions
    if (motions.layout.kinds[body] < 2).any():
        return int(motions.of_the_whole.shape[1])
    return int(np.round(np.trace(motions.held(body, motions.centroid(body)))))


def _common_centre(known: Knowledge, body: BoolArray, other: BoolArray, scaled: Array) -> int | None:
    """The variable that stands still in all motions (m, ways) of a body."""
    motions, d = known.motions, known.motions.dim
    centre, worst = motions.centroid(body), np.zeros(len(motions.layout))
    for column in scaled.T:
        t, w = column[:d], column[d:] / motions.lever
        off = np.linalg.norm(t + (motions.places - centre) @ motions.hat(w).T, axis=-1)
        worst = np.maximum(worst, off)
    first = int(np.argmin(worst))
    return int(motions.layout.keys[first]) if worst[first] < 1e-4 else None
