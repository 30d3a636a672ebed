"""Tags whose number stands at several places: moved on the way, or printed twice.

A number is no name to rely on: a tag that was carried to another room ties two rooms together that are far apart, and a
robust loss would rather forgive the two honest sightings that say so. So numbers are believed visit by visit:

    visit:   sightings of a tag by one robot with no break longer than BREAK_S
    maps:    what visits tie together, through images that show several, is mapped by itself (`by_targets`)
    merge:   two maps are one by the tags that both know; the most that agree on the distances between them decide, and
             the pair of maps with most is merged first. One tag alone is believed, as nothing speaks against it
    apart:   visits of one number that lie farther apart in one map than drift explains are different tags

Drift explains SLACK_M and SLACK of how far the map reaches (between two tags, of their distance): a tag that was moved
by less is not found out here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy.sparse as sp

from teamslam.frontend.streams import TICKS_PER_S
from teamslam.frontend.tags.by_targets import by_targets
from teamslam.geometry import Array, IntArray, Pose, align
from teamslam.model import Kind, Table, Values, index_of, is_landmark, landmark_key

BREAK_S = 60.0
SLACK_M, SLACK = 0.5, 0.15


@dataclass(frozen=True)
class Place:
    """One of the places of a tag: its key, which of its places (from 1, in time), and the spans [ticks] of visits."""

    tag: int
    number: int
    visits: tuple[tuple[int, int], ...]


def places_of_tags(tables: Sequence[Table]) -> list[Place]:
    """The places of all tags of one robot's sightings that have more than one; nothing of the others."""
    seen = [t.select(is_landmark(t.keys[:, 1])) for t in tables if t.model == "corners"]
    seen = [t for t in seen if len(t)]
    if not seen:
        return []
    visits = _Visits.of(seen)
    if len(visits.tag) == len(np.unique(visits.tag)):
        return []
    maps = [part for part in (_map_of(seen, visits, part) for part in visits.parts()) if part is not None]
    return _apart(_merged(maps, visits), visits)


@dataclass(frozen=True, eq=False)
class _Visits:
    """Visits (v,): their tag, first and last tick; of the rows (m,) of all tables, one after another, which each is of,
    and the place of its pose among `poses`."""

    tag: IntArray
    start: IntArray
    stop: IntArray
    of_row: IntArray
    frame: IntArray
    poses: IntArray

    @classmethod
    def of(cls, tables: Sequence[Table]) -> "_Visits":
        keys = np.concatenate([t.keys for t in tables])
        ticks, poses = index_of(keys[:, 0]), np.unique(keys[:, 0])
        order = np.lexsort([ticks, keys[:, 1]])
        tag, tick = keys[order, 1], ticks[order]
        new = np.append(True, (np.diff(tag) != 0) | (np.diff(tick) > BREAK_S * TICKS_PER_S))
        of_row = np.empty(len(keys), np.int64)
        of_row[order] = np.cumsum(new) - 1
        begins = np.flatnonzero(new)
        stops = np.append(begins[1:], len(tag)) - 1
        return cls(tag[begins], tick[begins], tick[stops], of_row, np.searchsorted(poses, keys[:, 0]), poses)

    def parts(self) -> list[IntArray]:
        """Rows that images with several visits tie together."""
        from scipy.sparse.csgraph import connected_components

        n, v = len(self.poses), len(self.tag)
        graph = sp.coo_array((np.ones(len(self.frame)), (self.frame, n + self.of_row)), shape=(n + v, n + v))
        part = connected_components(graph, directed=False)[1][self.frame]
        return [np.flatnonzero(part == number) for number in np.unique(part)]


@dataclass(frozen=True, eq=False)
class _Map:
    """Visits (k,) and where their tags stand (k,), in a frame of its own."""

    visits: IntArray
    places: Pose


def _map_of(tables: Sequence[Table], visits: _Visits, rows: IntArray) -> _Map | None:
    """A part, mapped by itself: each visit a landmark."""
    first, parts = 0, []
    for table in tables:
        own = rows[(rows >= first) & (rows < first + len(table))]
        keys = np.stack([table.keys[own - first, 0], landmark_key(visits.of_row[own])], -1)
        parts.append(replace(table.select(own - first), keys=keys))
        first += len(table)
    frames = np.unique(np.concatenate([part.keys[:, 0] for part in parts]))
    way = Values.of({Kind.POSE3: (frames, Pose.identity(3, (len(frames),)))})
    turns = (np.diff(index_of(frames)) / TICKS_PER_S) ** 2
    found = by_targets([part for part in parts if len(part)], way, turns)
    if found is None:
        return None
    marks = found.layout.keys[is_landmark(found.layout.keys)]
    return _Map(index_of(marks), found.poses_of(marks, 3))


def _merged(maps: list[_Map], visits: _Visits) -> list[_Map]:
    """Maps put together as far as tags that they share tell, those that agree on most first."""
    while True:
        pairs = combinations(range(len(maps)), 2)
        agreeing = [((a, b), _agreement(maps[a], maps[b], visits)) for a, b in pairs]
        agreeing = [(pair, same) for pair, same in agreeing if len(same)]
        if not agreeing:
            return maps
        (one, other), same = max(agreeing, key=lambda found: len(found[1]))
        maps = [m for k, m in enumerate(maps) if k not in (one, other)] + [_together(maps[one], maps[other], same)]


def _agreement(one: _Map, other: _Map, visits: _Visits) -> IntArray:
    """The most pairs (k, 2) of visits of the same tags, as places in the two maps, that agree on distances."""
    mine, theirs = visits.tag[one.visits], visits.tag[other.visits]
    pairs = np.argwhere(mine[:, None] == theirs[None])
    if not len(pairs):
        return pairs
    a, b = one.places.translation[pairs[:, 0]], other.places.translation[pairs[:, 1]]
    between = [np.linalg.norm(p[:, None] - p[None], axis=-1) for p in (a, b)]
    agree = np.abs(between[0] - between[1]) < SLACK_M + SLACK * np.minimum(*between)
    tags = mine[pairs[:, 0]]
    agree &= (tags[:, None] != tags[None]) | np.eye(len(tags), dtype=bool)  # of one tag one visit in each map
    best = pairs[:0]
    for seed in range(len(pairs)):
        group = [seed]
        for candidate in np.argsort(-agree.sum(1), kind="stable").tolist():
            if candidate != seed and agree[candidate, group].all():
                group.append(candidate)
        if len(group) > len(best):
            best = pairs[np.sort(group)]
    return best


def _together(one: _Map, other: _Map, same: IntArray) -> _Map:
    """Both in the frame of the first, by the tags that agree: their places, and how they stand."""
    a, b = one.places[same[:, 0]], other.places[same[:, 1]]
    fit = align(b.translation, a.translation, source_rotations=b.rotation, target_rotations=a.rotation).pose
    moved = fit[None] @ other.places
    places = Pose(
        np.concatenate([one.places.rotation, moved.rotation]),
        np.concatenate([one.places.translation, moved.translation]),
    )
    return _Map(np.concatenate([one.visits, other.visits]), places)


def _apart(maps: Sequence[_Map], visits: _Visits) -> list[Place]:
    """The tags whose visits lie apart within one map; visits in a map of their own stay with the first place."""
    out: list[Place] = []
    for tag in np.unique(visits.tag).tolist():
        own = np.flatnonzero(visits.tag == tag)
        if len(own) < 2:
            continue
        group = _groups(own, maps)
        if group.max() == 0:
            continue
        for number in range(int(group.max()) + 1):
            spans = tuple((int(visits.start[v]), int(visits.stop[v])) for v in own[group == number].tolist())
            out.append(Place(int(tag), number + 1, spans))
    return out


def _groups(own: IntArray, maps: Sequence[_Map]) -> IntArray:
    """Which place (k,) each visit of a tag is at, numbered in time."""
    home = [(m, int(np.flatnonzero(map.visits == v)[0])) for v in own.tolist()
            for m, map in enumerate(maps) if (map.visits == v).any()]  # fmt: skip
    group = np.zeros(len(own), np.int64)
    seats: list[tuple[int, Array]] = []
    for k, (m, at) in enumerate(home):
        place, most = maps[m].places.translation[at], SLACK_M + SLACK * _extent(maps[m])
        near = [g for g, (of, seat) in enumerate(seats) if of != m or np.linalg.norm(place - seat) < most]
        if near:
            group[k] = near[0]
        else:
            group[k] = len(seats)
            seats.append((m, place))
    return group


def _extent(map: _Map) -> float:
    """How far a map reaches [m]."""
    return float(np.linalg.norm(np.ptp(map.places.translation, axis=0)))
