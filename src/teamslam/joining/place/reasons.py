"""Why a cluster stands alone, in words: what ties it to the others, and what that leaves open.

Each sentence says what is known, and no more:

    they share nothing        there is no such row
    directions are open       by the null space of all rows at places that are not special: open there, open anywhere
    held, but loosely         by the join of the submaps concerned, at a place where all rows fit; as far as sigmas mean
                              anything, which for angles of a quarter turn they no longer do
    no place was found        the rows could hold the frame, but the search, which is bounded, found no place where they
                              fit and do; whether there is none, nobody knows
"""

import itertools
from collections import Counter
from dataclasses import dataclass

import numpy as np

from teamslam.joining.place.ties import Tied
from teamslam.model import WORLD, Submap, is_landmark, robot_of

LOOSE = 0.5  # [rad], and of the distance: a frame that is held less firmly is free
NO_PLACE = "no place was found"
MEANT = 0.5 * np.pi  # [rad], and of the distance: up to here a sigma is a sigma
WORDS = {
    "range_bearing": ("range and bearing", "ranges and bearings"),
    "relative_pose": ("relative pose", "relative poses"),
    "position": ("position in the world", "positions in the world"),
    "pose": ("pose in the world", "poses in the world"),
}


@dataclass(frozen=True)
class Held:
    """How submaps that were joined hang together: whether what ties them `fits` one frame, and how well the frame that
    is known least is known there: `turn` [rad], `place` [m], at a `distance` [m]; infinite where it is open."""

    fits: bool
    turn: float
    place: float
    distance: float

    @property
    def looseness(self) -> float:
        """How loosely it is held: above LOOSE it is free to turn or to move."""
        return max(self.turn, self.place / max(self.distance, 1e-9))

    @property
    def firm(self) -> bool:
        """Whether the frame is held."""
        return bool(self.looseness <= LOOSE)

    @property
    def told(self) -> bool:
        """Whether it is known how loosely it is held: a sigma beyond that says nothing of what lies so far off."""
        return bool(self.fits and not self.firm and self.looseness <= MEANT)


def why_apart(submap: Submap, tied: Tied, free: int, held: Held | None) -> str:
    """The reason of the cluster that begins with `submap`, the second of the bodies in `tied`, of which it can move
    against the first in `free` directions wherever they are; where that is none, how they are `held` at the best place
    that was found."""
    names = submap.names
    who = f"the submaps of robot {names.robot(int(robot_of(submap.base)))} from {names.describe(submap.base)} on"
    rows = Counter[str]()
    things: set[int] = set()
    for tie in tied.ties:
        mine = (tie.ends == 1).any(0)
        if not tie.measured:
            things |= set(tie.table.keys[mine, 0].tolist())
        elif mine.any():
            rows[tie.table.model] += int(mine.sum())
    if not things and not rows:
        return (
            f"{who} share nothing with the map: no common landmark, and neither robot saw the other; "
            f"{'two' if submap.base_dim == 2 else 'three'} common landmarks, or one sighting of a robot's pose, would "
            f"join them"
        )
    more = "two more common landmarks" if free == 3 and submap.base_dim == 3 else "one more common landmark"
    what = ", ".join(_what(submap, key) for key in itertools.islice(sorted(things), 6))
    if not rows and free:
        return (
            f"{who} share only {what} with the map and can still turn about {'it' if len(things) == 1 else 'them'}: "
            f"under-constrained, {_directions(free)} free; {more} elsewhere, or one sighting of a robot's pose, would "
            f"join them"
        )
    ties = " and ".join([f"{n} {_noun(m, n)}" for m, n in rows.items()] + ([what] if things else []))
    tied_by = f"{who} are tied to the map by {ties}"
    cure = f"sightings from other sides and farther apart, {more}, or one sighting of a robot's pose, would join them"
    if free:
        return f"{tied_by}, which leave {_directions(free)} of their frame open: under-constrained; {cure}"
    if held is not None and held.told:
        known = f"its heading to {held.turn:.2g} rad and its place to {held.place:.2g} m"
        return f"{tied_by}, which at these sigmas hold their frame but loosely ({known}): under-constrained; {cure}"
    suspects = f"wrong {' or '.join(_noun(m, 2) for m in rows)}" if rows else "landmarks that were taken for others"
    return (
        f"{tied_by}, which could hold their frame, but {NO_PLACE} where they fit and do; sightings "
        f"from other sides and farther apart would tell; else look for {suspects}, for odometry that is worse than it "
        f"says, or for a submap whose own measurements fit another map as well"
    )


def _what(submap: Submap, key: int) -> str:
    if key == WORLD:
        return "the world"
    return f"landmark {submap.names.landmark(key)}" if is_landmark(key) else submap.names.describe(key)


def _directions(count: int) -> str:
    return f"{count} direction{'' if count == 1 else 's'}"


def _noun(model: str, count: int) -> str:
    return WORDS.get(model, (model, model + "s"))[count != 1]
