"""How one part of a map moves against another: it turns about something, or it shifts.

The motions that fit a displacement of two parts best differ by (t, w), a linear function F of the displacement. About
the middle c of the first part it moves the places p of that part by t + w x (p - c), and leaves those of its pivot
where they are.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.model import WORLD, is_landmark
from teamslam.trust.weak.motions import Motions

STANDS = 0.1  # of what the part moves: what moves less is a pivot
ON_AXIS = 0.01  # of the same: what moves less stands on the axis of a turn
SHIFTS = 0.05  # of a shift: a turn that adds less is none


@dataclass(frozen=True, eq=False)
class Hinge:
    """One freedom of a part against another: `kind` 'turn' or 'shift'. `pivot` are the keys of what stands still in it,
    two where it is the line through them, none where it is just the place `at` (dim,). `axis`: of the turn (1 or 3,),
    or the direction of the shift (dim,). `function` (dof,): how far a displacement of the map turns or shifts it."""

    kind: str
    pivot: tuple[int, ...]
    at: Array
    axis: Array
    function: Array

    def __repr__(self) -> str:
        return f"Hinge({self.kind} about {len(self.pivot)} variables)"


def relative(motions: Motions, part: BoolArray, against: BoolArray) -> Array:
    """F (m, dof): the motion of a part against another, about the middle of the first; against none, in the world."""
    centre = motions.centroid(part)
    if not against.any():
        return motions.fit(part, centre)
    return np.asarray(motions.fit(part, centre) - motions.held(part, centre) @ motions.fit(against, centre))


def hinge_of(motions: Motions, part: BoolArray, against: BoolArray, field: Array) -> Hinge:
    """What a displacement (dof,) of the map is of a part against another."""
    d, F = motions.dim, relative(motions, part, against)
    t, w = np.split(F @ field, [d])
    centre, count = motions.centroid(part), int(part.sum())
    turned, moved = _length_of_turn(motions, part, w), float(np.sqrt(count) * np.linalg.norm(t))
    reach = float(np.hypot(turned, moved) / np.sqrt(count))
    shift = Hinge("shift", (), centre, _unit(t), _unit(t) @ F[:d])
    if turned <= SHIFTS * moved:
        return shift
    hat = motions.hat(w)
    still = np.linalg.norm(t + (motions.places - centre) @ hat.T, axis=-1)
    pivot = _pivot(motions, np.flatnonzero(still <= STANDS * reach), still, reach, hat)
    if not len(pivot) and turned < moved:
        return shift
    at = motions.places[pivot].mean(0) if len(pivot) else centre - np.linalg.pinv(hat) @ t
    keys = tuple(motions.layout.keys[pivot].tolist())
    return Hinge("turn", keys, at, _unit(w) @ motions.axes, _unit(w) @ F[d:])


def _pivot(motions: Motions, candidates: IntArray, still: Array, reach: float, hat: Array) -> IntArray:
    """The variable that stands still most, a landmark if there is one; of a turn in space, two if they stand on its
    axis as well."""
    keys = motions.layout.keys[candidates]
    marks = candidates[is_landmark(keys) & (keys != WORLD)]
    candidates = marks if len(marks) else candidates
    if not len(candidates):
        return candidates
    first = int(candidates[np.argmin(still[candidates])])
    if len(motions.axes) == 1:
        return np.array([first])
    candidates = candidates[still[candidates] <= max(ON_AXIS * reach, 2.0 * still[first])]
    along = (motions.places[candidates] - motions.places[first]) @ _line(hat)
    far = int(candidates[np.argmax(np.abs(along))])
    if np.abs(along).max() <= motions.lever * STANDS:
        return np.array([first])
    return np.sort(np.array([first, far]))


def _line(hat: Array) -> Array:
    """The direction (dim,) that a turn leaves alone; zero in the plane."""
    _, singular, directions = np.linalg.svd(hat)
    return np.asarray(directions[singular < 0.5 * singular[0]].sum(0))


def _length_of_turn(motions: Motions, part: BoolArray, w: Array) -> float:
    """How long the displacement of a part is that turns it by w about its middle."""
    moved = motions.columns @ (motions.moved(motions.centroid(part))[:, motions.dim :] @ w)
    return float(np.sqrt(np.sum((motions.weight * moved**2)[motions.rows(part)])))


def _unit(x: Array) -> Array:
    length = float(np.linalg.norm(x))
    return x / length if length > 0.0 else x
