"""Tags whose number stands at several places: moved on the way, or printed twice.

A number is no name to rely on: a tag that was carried to another room ties two rooms together that are far apart, and a
robust loss would rather forgive the two honest sightings that say so. So numbers are believed visit by visit
(`visits`), and what is seen with a tag tells whether two of its visits are of one place:

    beside:  tags that were seen near both visits in time agree where they are as far from each other each time. Where
             FEWEST or more all do, they decide: a tag that agrees with half of the NEAREST is where it was, another one
             is elsewhere. A whole way that is walked again long after is never taken for tags that were moved, however
             far the map has drifted meanwhile, or where it is bent: what is near each other agrees
    merge:   where fewer do, maps tell. Two are one by the tags that both know; the most that agree on the distances
             between them decide, and the pair of maps with most is merged first. One tag alone is believed, as nothing
             speaks against it. Visits farther apart in one map than drift explains are different tags

A visit of fewer than SIGHTINGS sightings is a misread, and makes no place. Drift explains SLACK_M and SLACK of the
distance, with SIGMAS of how well it is known, or of how far the map reaches: a tag that was moved by less is not found
out here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.visits import BREAK_S, VisitMap, Visits, map_of
from teamslam.geometry import Array, BoolArray, IntArray, Pose, align
from teamslam.model import Table, is_landmark

SLACK_M, SLACK, SIGMAS = 0.5, 0.15, 4.0
BESIDE_S = 20.0  # before and after a visit: what else is seen there
FEWEST, NEAREST = 3, 6  # tags that agree, to decide; and those that are asked
SIGHTINGS = 3  # of a visit, that make a place: fewer are misreads
BESIDE = round(BREAK_S / 3.0 * TICKS_PER_S)  # of a visit, at which there is no other of the same tag


@dataclass(frozen=True)
class Place:
    """One of the places of a tag: its key, which of its places (from 1, in time), and the spans [ticks] in which it was
    seen there and nowhere else between; what is seen `beside_ticks` before or after them is of it, too."""

    tag: int
    number: int
    visits: tuple[tuple[int, int], ...]
    beside_ticks: int = 0


def places_of_tags(tables: Sequence[Table]) -> list[Place]:
    """The places of all tags of one robot's sightings that have more than one; nothing of the others."""
    seen = [t.select(is_landmark(t.keys[:, 1])) for t in tables if t.model == "corners"]
    seen = [t for t in seen if len(t)]
    if not seen:
        return []
    visits = Visits.of(seen)
    if not visits.again:
        return []
    maps = [part for part in (map_of(seen, visits, part) for part in visits.parts()) if part is not None]
    told = _Told(visits, maps)
    places = []
    known = np.bincount(visits.of_row, minlength=len(visits.tag)) >= SIGHTINGS
    for tag in np.unique(visits.tag[known]).tolist():
        own = np.flatnonzero(known & (visits.tag == tag))
        places += places_in_time(int(tag), visits.start[own], visits.stop[own], told.seats(own), BESIDE)
    return places


def places_in_time(tag: int, starts: IntArray, stops: IntArray, seat: IntArray, beside_ticks: int = 0) -> list[Place]:
    """A tag's places, where there are several: which `seat` (k,) it had, from start to stop (k,), in the order of
    time."""
    held = np.unique(seat)
    if len(held) < 2:
        return []
    first = np.append(True, np.diff(seat) != 0)
    spans = list(zip(seat[first], starts[first].tolist(), stops[np.append(first[1:], True)].tolist(), strict=True))
    return [
        Place(tag, number, tuple((start, stop) for of, start, stop in spans if of == place), beside_ticks)
        for number, place in enumerate(held.tolist(), 1)
    ]


class _Told:
    """What maps of visits tell of each other."""

    def __init__(self, visits: Visits, maps: Sequence[VisitMap]) -> None:
        self.visits, self.maps = visits, maps
        self.home = {v: (map, k) for map in maps for k, v in enumerate(map.visits.tolist())}

    def seats(self, own: IntArray) -> IntArray:
        """Which place (k,) each visit of one tag is at, in the order of time: where most of the visits there say it is
        the same; a new one where all say that it is another."""
        seat, count = np.zeros(len(own), np.int64), 1
        for k in range(1, len(own)):
            votes = np.array([self._same(int(before), int(own[k])) for before in own[:k].tolist()])
            each = [int(votes[seat[:k] == place].sum()) for place in range(count)]
            seat[k] = int(np.argmax(each)) if max(each) >= 0 else count
            count = max(count, int(seat[k]) + 1)
        return seat

    def _same(self, one: int, other: int) -> int:
        """1 if two visits of a tag are of one place, -1 if of two, 0 if nothing tells."""
        if one not in self.home or other not in self.home:
            return 0
        beside = self._beside(one, other)
        return self._merged_same(one, other) if beside is None else beside

    def _beside(self, one: int, other: int) -> int | None:
        """The same by what was seen near both in time; None where that is too little to decide."""
        (here, at_a), (there, at_b) = self.home[one], self.home[other]
        mine, theirs = self._near(here, one), self._near(there, other)
        tags = [self.visits.tag[map.visits[near]] for map, near in ((here, mine), (there, theirs))]
        _, shared, again = np.intersect1d(tags[0], tags[1], return_indices=True)
        mine, theirs = mine[shared], theirs[again]
        if len(mine) < FEWEST or len(_all_agree(_off(here.apart(mine, mine), there.apart(theirs, theirs)))) < FEWEST:
            return None
        a, b = here.apart(np.array([at_a]), mine)[0], there.apart(np.array([at_b]), theirs)[0]
        nearest = np.argsort(np.maximum(a, b), kind="stable")[:NEAREST]  # by both: a map may be folded
        if _mostly(_off(a[nearest], b[nearest])):
            return 1
        # What seems to be apart may be poorly known.
        sigma = np.hypot(here.sigma(at_a, mine[nearest]), there.sigma(at_b, theirs[nearest]))
        return 1 if _mostly(_off(a[nearest], b[nearest], sigma)) else -1

    def _near(self, map: VisitMap, visit: int) -> IntArray:
        """The visits of other tags that a map shows of the time of a visit, as places in it."""
        v, beside = self.visits, round(BESIDE_S * TICKS_PER_S)
        start, stop = v.start[visit] - beside, v.stop[visit] + beside
        others = np.flatnonzero((v.start[map.visits] <= stop) & (v.stop[map.visits] >= start))
        return np.asarray(others[v.tag[map.visits[others]] != v.tag[visit]])

    def _merged_same(self, one: int, other: int) -> int:
        for whole in self._wholes:
            at = [np.flatnonzero(whole.visits == visit) for visit in (one, other)]
            if len(at[0]) and len(at[1]):
                apart = float(np.linalg.norm(whole.places.translation[at[0][0]] - whole.places.translation[at[1][0]]))
                return 1 if apart < SLACK_M + SLACK * whole.reach else -1
        return 0

    @cached_property
    def _wholes(self) -> list["_Whole"]:
        return _merged([_Whole(map.visits, map.places) for map in self.maps], self.visits)


def _off(here: Array, there: Array, sigma: Array | float = 0.0) -> Array:
    """How much distances differ, over what drift explains, and what is not known of them."""
    return np.asarray(np.abs(here - there) / (SLACK_M + SLACK * np.minimum(here, there) + SIGMAS * sigma))


def _mostly(off: Array) -> bool:
    """Whether half of some agree at least."""
    return bool(2 * np.count_nonzero(off < 1.0) >= len(off))


def _all_agree(off: Array) -> IntArray:
    """The most that all agree with each other, as found by going on greedily from each of them."""
    agree: BoolArray = off < 1.0
    likely, best = np.argsort(-agree.sum(1), kind="stable"), np.zeros(0, np.int64)
    for seed in range(len(agree)):
        group = agree[seed].copy()
        for candidate in likely.tolist():
            if group[candidate]:
                group &= agree[candidate]
        if group.sum() > len(best):
            best = np.flatnonzero(group)
    return best


@dataclass(frozen=True, eq=False)
class _Whole:
    """Visits (k,) and where their tags stand (k,), in a frame of its own."""

    visits: IntArray
    places: Pose

    @property
    def reach(self) -> float:
        """How far it reaches [m]."""
        return float(np.linalg.norm(np.ptp(self.places.translation, axis=0)))


def _merged(maps: list[_Whole], visits: Visits) -> list[_Whole]:
    """Maps put together as far as tags that they share tell, those that agree on most first."""
    while True:
        pairs = combinations(range(len(maps)), 2)
        agreeing = [((a, b), _agreement(maps[a], maps[b], visits)) for a, b in pairs]
        agreeing = [(pair, same) for pair, same in agreeing if len(same)]
        if not agreeing:
            return maps
        (one, other), same = max(agreeing, key=lambda found: len(found[1]))
        maps = [m for k, m in enumerate(maps) if k not in (one, other)] + [_together(maps[one], maps[other], same)]


def _agreement(one: _Whole, other: _Whole, visits: Visits) -> IntArray:
    """The most pairs (k, 2) of visits of the same tags, as places in the two maps, that agree on distances."""
    mine, theirs = visits.tag[one.visits], visits.tag[other.visits]
    pairs = np.argwhere(mine[:, None] == theirs[None])
    if not len(pairs):
        return pairs
    a, b = one.places.translation[pairs[:, 0]], other.places.translation[pairs[:, 1]]
    between = [np.linalg.norm(p[:, None] - p[None], axis=-1) for p in (a, b)]
    agree = _off(between[0], between[1])
    tags = mine[pairs[:, 0]]
    agree[(tags[:, None] == tags[None]) & ~np.eye(len(tags), dtype=bool)] = np.inf  # of one tag one visit in each map
    return np.asarray(pairs[np.sort(_all_agree(agree))])


def _together(one: _Whole, other: _Whole, same: IntArray) -> _Whole:
    """Both in the frame of the first, by the tags that agree: their places, and how they stand."""
    a, b = one.places[same[:, 0]], other.places[same[:, 1]]
    fit = align(b.translation, a.translation, source_rotations=b.rotation, target_rotations=a.rotation).pose
    moved = fit[None] @ other.places
    places = Pose(
        np.concatenate([one.places.rotation, moved.rotation]),
        np.concatenate([one.places.translation, moved.translation]),
    )
    return _Whole(np.concatenate([one.visits, other.visits]), places)
