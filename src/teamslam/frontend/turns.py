"""How late stamps are, by how fast a robot turned: the first guess of a clock's offset, from a second to either side.

Two sightings of a tag, a moment apart, tell through what angle the robot turned meanwhile, wherever camera and tag are:
an angle does not change with the frame in which it is looked at. Odometry tells the same of any two moments; the offset
is where both agree best,

    min over d of   sum | seen_i - angle of X(s_i - d)^-1 X(t_i - d) |

by absolute values, so that a tag whose pose flipped counts once (`frontend.shifts`).
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.shifts import SHIFTS_S, clearest
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.geometry import Array, IntArray, Pose, so3

LONGEST_S = 2.0  # between two sightings
MOST = 400  # pairs of sightings
FEWEST = 8


@dataclass(frozen=True, eq=False)
class Turns:
    """Angles (n,) [rad] through which something turned from `start` to `stop` (n,) [ticks]."""

    start: IntArray
    stop: IntArray
    angle: Array

    def select(self, rows: IntArray) -> "Turns":
        """Some of them."""
        return Turns(self.start[rows], self.stop[rows], self.angle[rows])


def turns_between(ticks: IntArray, of: IntArray, rotations: Array) -> Turns:
    """How each thing `of` (m,) that was seen at `ticks` (m,) with `rotations` (m, 3, 3) had turned when it was seen
    again (see `pairs_between`)."""
    before, after = pairs_between(ticks, of)
    turned = np.swapaxes(rotations[before], -1, -2) @ rotations[after]
    return Turns(ticks[before], ticks[after], np.linalg.norm(so3.log(turned), axis=-1))


def pairs_between(ticks: IntArray, of: IntArray) -> tuple[IntArray, IntArray]:
    """Each sighting (n,) of a thing `of` (m,) that was seen at `ticks` (m,), and the last one (n,) that is at most
    LONGEST_S later, as long turns tell most."""
    things = np.unique(of)
    begins, ends = [], []
    for thing in things:
        mine = np.flatnonzero(of == thing)
        mine = mine[np.argsort(ticks[mine], kind="stable")]
        last = np.searchsorted(ticks[mine], ticks[mine] + round(LONGEST_S * TICKS_PER_S), "right") - 1
        later = ticks[mine[last]] > ticks[mine]
        begins.append(mine[later])
        ends.append(mine[last[later]])
    none = [np.zeros(0, np.int64)]
    return np.concatenate([*none, *begins]), np.concatenate([*none, *ends])


def lateness(turns: Turns, track: Track, near_s: float = 0.0) -> float | None:
    """How much later than odometry's the stamps of turns are [s], within a second of `near_s`; None where the turns do
    not tell it, or not clearly."""
    if len(turns.angle) < FEWEST or len(track) < 2:
        return None
    if len(turns.angle) > MOST:
        turns = turns.select(np.linspace(0, len(turns.angle) - 1, MOST).astype(int))
    track = _in_order(track)
    late = np.round((near_s + SHIFTS_S) * TICKS_PER_S).astype(np.int64)
    ends = np.stack([turns.start, turns.stop])[:, None] - late[:, None]
    poses, _ = interpolate(track.ticks, track.poses, ends.ravel(), int(TICKS_PER_S))
    rotations = poses.rotation.reshape(*ends.shape, 3, 3)
    inside = ((ends >= track.ticks[0]) & (ends <= track.ticks[-1])).all((0, 1))
    if np.count_nonzero(inside) < FEWEST:
        return None
    shift = clearest(np.abs(_angles(rotations[0], rotations[1])[:, inside] - turns.angle[inside]))
    return None if shift is None else near_s + shift


def _in_order(track: Track) -> Track:
    """A track by rising stamps, each once."""
    _, first = np.unique(track.ticks, return_index=True)
    return track.select(first)


def _angles(before: Array, after: Array) -> Array:
    trace = np.einsum("...ij,...ij->...", before, after)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))


def carried_along(track: Track, ticks: IntArray) -> Pose:
    """Where a robot was by its odometry at `ticks` (m,): for turns of what it saw, taken out of its own frame."""
    track = _in_order(track)
    return interpolate(track.ticks, track.poses, ticks, int(TICKS_PER_S))[0]
