"""Which parts of a map move as one.

Of what is open, exactly: variables that every open displacement moves by the same rigid motion are one body. Of a weak
direction, as nearly as can be: two parts, each with the motion that fits it best (Lloyd's iteration from cuts by robot,
time and place), such that least of the direction is left.
"""

from collections.abc import Iterator

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import is_pose, robot_of
from teamslam.trust.weak.motions import Motions

ROUNDS = 30
STANDS = 0.1  # of what a part moves: what moves less stands still
SAME = 1e-5  # of the longest displacement: motions nearer than this are one


def in_two(motions: Motions, field: Array) -> tuple[BoolArray, float]:
    """The part (n,) of the variables that moves against the rest, the smaller one, and the share of |field|^2 that the
    two motions explain."""
    quadratic = _Quadratic.of(motions, field)
    best, left = np.zeros(len(motions.layout), bool), np.inf
    for start in _cuts(motions, field):
        part = _settled(quadratic, start)
        if part.any() and not part.all() and (cost := quadratic.left(part)) < left * (1.0 - 1e-9):
            best, left = part, cost
    return _without_hinges(quadratic, _smaller(best)), 1.0 - left / float(quadratic.length.sum())


def _without_hinges(quadratic: "_Quadratic", part: BoolArray) -> BoolArray:
    """A part without what its motion and the rest's leave in the same place: that belongs to the rest."""
    if not part.any():
        return part
    between = quadratic.off(quadratic.motion(part)), quadratic.off(quadratic.motion(~part))
    apart = np.abs(between[0] - between[1])
    kept = part & (apart > STANDS**2 * apart[part].mean())
    return kept if kept.any() else part


def bodies(motions: Motions, open_: Array) -> list[BoolArray]:
    """The rigid bodies (n,) among variables that the displacements `open_` (dof, q) let move, the largest first."""
    layout, reach = motions.layout, motions.lever
    scale = float(np.abs(open_).max(initial=0.0)) or 1.0
    left = np.ones(len(layout), bool)
    found: list[BoolArray] = []
    own = {int(place): _own_motion(motions, open_, int(place)) for place in np.flatnonzero(layout.kinds < 2)}
    tolerance = SAME * scale * (1.0 + np.ptp(motions.places, axis=0).max() / reach)
    while own:
        first = min(own)
        body = _follows(motions, open_, own[first], tolerance)
        body[first] = True  # by its own motion, whatever rounding leaves between the two
        found.append(body)
        own = {place: m for place, m in own.items() if not body[place]}
    # What stands on the border of two bodies belongs to the larger.
    found = [body for body in sorted(found, key=lambda b: (-int(b.sum()), int(np.argmax(b))))]
    whole = []
    for body in found:
        whole.append(body & left)
        left = left & ~body
    for place in np.flatnonzero(left).tolist():
        whole.append(np.arange(len(layout)) == place)
    return sorted((b for b in whole if b.any()), key=lambda b: (-int(b.sum()), int(np.argmax(b))))


def _own_motion(motions: Motions, open_: Array, place: int) -> Array:
    """The motion (m, q) about the origin of a pose in each open displacement."""
    layout = motions.layout
    rows = slice(int(layout.dof_start[place]), int(layout.dof_start[place + 1]))
    centre = motions.places[place]
    about = motions.columns[rows] @ motions.moved(centre)  # well conditioned: columns of zeros and of rotations
    return np.asarray(motions.moved(centre) @ (np.linalg.pinv(about) @ open_[rows]))


def _follows(motions: Motions, open_: Array, motion: Array, tolerance: float) -> BoolArray:
    """The variables (n,) that move by `motion` (m, q) in each open displacement."""
    off = np.sqrt(motions.weight)[:, None] * (open_ - motions.columns @ motion)
    longest = np.maximum.reduceat(np.abs(off).max(-1, initial=0.0), motions.layout.dof_start[:-1])
    return np.asarray(longest < tolerance)


class _Quadratic:
    """What is left of a field in a part, |v - G m|^2, from sums over its variables."""

    def __init__(self, gram: Array, right: Array, length: Array) -> None:
        self.gram, self.right, self.length = gram, right, length

    @classmethod
    def of(cls, motions: Motions, field: Array) -> "_Quadratic":
        """Sums for each variable: G'MG (n, m, m), G'Mv (n, m), v'Mv (n,), about the middle of all."""
        whole = np.ones(len(motions.layout), bool)
        root = np.sqrt(motions.weight)
        G = root[:, None] * (motions.columns @ motions.moved(motions.centroid(whole)))
        v = root * field
        starts = motions.layout.dof_start[:-1]
        return cls(
            np.add.reduceat(G[:, :, None] * G[:, None, :], starts),
            np.add.reduceat(G * v[:, None], starts),
            np.add.reduceat(v * v, starts),
        )

    def motion(self, part: BoolArray) -> Array:
        """The best motion (m,) of a part."""
        gram = self.gram[part].sum(0)
        return np.asarray(np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ self.right[part].sum(0))

    def off(self, motion: Array) -> Array:
        """What is left of each variable (n,) by a motion."""
        return np.asarray(self.length - 2.0 * self.right @ motion + np.einsum("i,nij,j->n", motion, self.gram, motion))

    def left(self, part: BoolArray) -> float:
        """What is left of all by the best motions of a part and of the rest."""
        return float(sum(self.off(self.motion(p))[p].sum() for p in (part, ~part)))


def _settled(quadratic: _Quadratic, part: BoolArray) -> BoolArray:
    for _ in range(ROUNDS):
        if not part.any() or part.all():
            return part
        one, other = quadratic.off(quadratic.motion(part)), quadratic.off(quadratic.motion(~part))
        # What fits either as well, such as a hinge, stays where it is.
        tie = np.abs(one - other) <= 1e-6 * quadratic.length.mean()
        new = np.where(tie, part, one < other)
        if (new == part).all():
            return part
        part = new
    return part


def _cuts(motions: Motions, field: Array) -> Iterator[BoolArray]:
    """Parts to begin with."""
    keys, places = motions.layout.keys, motions.places
    robots = np.where(is_pose(keys), robot_of(keys), 0)
    for robot in np.unique(robots[robots > 0]).tolist():
        own = robots == robot
        yield own
        order = np.sort(keys[own])
        for quarter in (1, 2, 3):
            yield own & (keys >= order[len(order) * quarter // 4])
    for axis in places.T:
        yield axis > np.median(axis)
    moved = np.add.reduceat(motions.weight * field**2, motions.layout.dof_start[:-1])
    yield np.arange(len(keys)) == int(np.argmax(moved))
    yield moved > 0.5 * moved.max()
    yield moved > 0.1 * moved.max()


def _smaller(part: BoolArray) -> BoolArray:
    return part if 2 * int(part.sum()) <= len(part) else ~part
