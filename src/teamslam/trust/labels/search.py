"""The search for names that lie: the change that explains most, then the next, until none is sure.

    bound     what any change could explain at most, by what all constellations cost together (`most_to_gain`)
    screen    what each landmark's name could explain, from their factor (`doubts`)
    propose   each robot's constellation that is left on the map of the others', under every change
    verify    all constellations joined anew with the change: what that costs decides
    who       the same change of another robot's names may explain as much: then nobody can say whose names are wrong,
              though the map is the same

A change is believed at a thousand to one, and where a landmark is said to stand elsewhere, if its misfit is no chance
beside that of the robot's others.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import comb, log

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array
from teamslam.joining import Component, Joined, join
from teamslam.joining.exact.gap import point_of
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.robust_fit import link
from teamslam.model import Submap, Values
from teamslam.solver import Factor, Options
from teamslam.trust.evidence import SURE, Fit, most_to_gain, ratio_by_chance, unlikely
from teamslam.trust.influence.liars import fit_of
from teamslam.trust.influence.removal import without
from teamslam.trust.influence.together import together
from teamslam.trust.labels.alignment import Stars, closely, roughly
from teamslam.trust.labels.changes import Change, assumed, changes
from teamslam.trust.labels.constellations import constellations, renamed
from teamslam.trust.labels.doubts import doubts_of

FAULTY = 2.0 * log(100.0)  # of -2 log L: the names of one robot of a hundred lie
BENDS = 1.1  # times what a first step promises that names may bring
LEVEL = 1e-3  # the share of honest teams in which a landmark is said to have moved
CLOSELY, VERIFIED = 3, 3  # changes of each kind that are tried closely; that are verified
MOST = 50  # changes in all
FEW = 2  # changes of one robot's names that are told, however few it knows
QUICK = Options(max_iterations=60, decrement=0.1, elsewhere=False)  # costs to a hundredth are enough

Stars_ = dict[int, list[Submap]]


@dataclass(frozen=True, eq=False)
class Finding:
    """A change of names that the team's maps speak for: its `odds` (natural logarithm) against none, and `instead`, the
    robots of which the same change explains as much. `apart_m`: how far what was one is apart, or what was called by
    one name is from where it is. `explains`: the share of what landmarks cost too much that is gone with it."""

    change: Change
    odds: float
    instead: tuple[int, ...]
    apart_m: float
    explains: float


def mislabelled(
    submaps: Sequence[Submap], joined: Joined | None = None, *, of: Collection[int] | None = None
) -> list[Finding]:
    """The names of landmarks that lie in a team's submaps, the surest first; each is mended before the next is sought.

    `joined`: their map, where it is known; it only saves time. `of`: the robots whose names are doubted; None: all.
    Law: with right names and noise as stated, or larger by one factor for all, nothing is found but at the rate LEVEL.
    Robots that know fewer than three landmarks in common with the others' cannot be judged, and one of whose names
    more than a quarter would lie has other faults than names: of it nothing is said here; nor of a team whose landmarks
    alone hold no map together (one seen in the plane by some, in space by others).
    """
    stars = constellations(submaps)
    near = point_of(joined.map) if joined is not None and len(joined.components) == 1 else None
    found: list[Finding] = []
    few = {robot: max(FEW, sum(len(own.landmark_keys) for own in parts) // 4) for robot, parts in stars.items()}
    while len(stars) > 1 and len(found) < MOST:
        try:
            joined, near = _joined(stars, near), None
        except TeamslamError:
            break  # what all rows together hold, landmarks alone may leave open: then these tell nothing
        best = _best(stars, joined, stars.keys() if of is None else stars.keys() & set(of))
        if best is None:
            break
        found.append(best)
        who = best.change.robot
        if sum(each.change.robot == who for each in found) > few[who]:
            found = [each for each in found if each.change.robot != who]
            stars = {robot: parts for robot, parts in stars.items() if robot != who}
            continue
        stars = {**stars, best.change.robot: [renamed(s, best.change.names) for s in stars[best.change.robot]]}
    return found


def _best(stars: Stars_, joined: Joined, doubted: Collection[int]) -> Finding | None:
    """The change that explains most, if it is sure."""
    parts = _doubtful(stars, joined, doubted)
    proposed = [p for robot, own in parts for p in _proposed(robot, own, stars, joined)]
    if not proposed:
        return None
    proposed.sort(key=lambda p: -p[0])
    before = fit_of(joined)
    gains = {change: _gain(before, change, stars) - prior for _, prior, change in proposed[:VERIFIED]}
    change = max(gains, key=lambda c: gains[c])
    if gains[change] < SURE:
        return None
    prior = next(prior for _, prior, c in proposed if c == change)
    others = [Change(change.kind, robot, change.one, change.other) for robot in stars if robot != change.robot]
    others = [other for other in others if change.kind == "exchanged" and _knows(stars[other.robot], other)]
    rivals = [other.robot for other in others if _gain(before, other, stars) - prior > gains[change] - SURE]
    after = _changed(change, stars)
    excess = before.cost - before.dof
    explains = min((before.cost - fit_of(after).cost) / excess, 1.0) if excess > 0.0 else 1.0
    return Finding(change, 0.5 * gains[change], tuple(rivals), _apart(change, after), explains)


def _doubtful(stars: Stars_, joined: Joined, doubted: Collection[int]) -> list[tuple[int, Submap]]:
    """The robots' constellations of which some change of names could explain something: by what all cost together, and
    by what the first step says."""
    before = fit_of(joined)
    parts = [(robot, own) for robot in sorted(doubted) for own in stars[robot]]
    parts = [(robot, own) for robot, own in parts if most_to_gain(before) > _least_prior(own) + SURE]
    if len(joined.components) > 1 or not parts:
        return parts
    map, none, found = joined.map, unlikely(before, before), []
    factor = Factor.of(map.values.layout, map.information, map.names, map.values)
    for robot, own in parts:
        doubts, n = doubts_of(own, map, factor), len(own.landmark_keys)
        most = ((doubts.two, 0, comb(n, 2)), (float(doubts.alone.max()), doubts.dof, n))
        fits = [(Fit(max(before.cost - BENDS * gone, 0.0), before.dof - dof), count) for gone, dof, count in most]
        if any(none - unlikely(before, fit) > _prior(count) + SURE for fit, count in fits):
            found.append((robot, own))
    return found


def _least_prior(own: Submap) -> float:
    """Of the kind of change to a constellation's names of which there are fewest."""
    n = len(own.landmark_keys)
    return _prior(min(n, comb(n, 2)))


def _prior(count: int) -> float:
    """-2 log of the chance that one change of so many is what is wrong with a robot's names."""
    return FAULTY + 2.0 * log(count)


def _proposed(robot: int, own: Submap, stars: Stars_, joined: Joined) -> list[tuple[float, float, Change]]:
    """Changes of a robot's names that would explain something, by how much, with their prior."""
    sky = _sky(robot, own, stars, joined)
    if sky is None:
        return []
    dim = 2 + int(max((part.values.layout.kinds % 2).max() for part in (own, sky)))
    mine, theirs = Stars.of(own, dim), Stars.of(sky, dim)
    given = assumed(None, mine, theirs)
    if (given >= 0).sum() < 3:
        return []
    tried = changes(robot, mine, theirs, _misfit(mine, theirs, own.base_dim))
    if not tried:
        return []
    ways = np.array([given, *(assumed(change, mine, theirs) for change in tried)])
    rough, frames = roughly(mine, theirs, ways, own.base_dim)
    whole = closely(mine, theirs, ways[0], frames[0])
    none = unlikely(whole, whole)
    n = len(own.landmark_keys)
    counts = {"exchanged": comb(n, 2), "mistaken": n * max(len(sky.landmark_keys) - n, 1), "apart": n}
    found = []
    for kind, count in counts.items():
        of_kind = [n for n, change in enumerate(tried, start=1) if change.kind == kind]
        for n in sorted(of_kind, key=lambda n: rough[n])[:CLOSELY]:
            fit = closely(mine, theirs, ways[n], frames[n])
            prior = _prior(count)
            gain = none - unlikely(whole, fit) - prior
            if gain > 0.0 and (kind != "apart" or _no_chance(whole, fit, count * len(stars))):
                found.append((gain, prior, tried[n - 1]))
    return found


def _no_chance(whole: Fit, rest: Fit, tries: int) -> bool:
    return ratio_by_chance(whole.minus(rest), rest) * tries < LEVEL


def _sky(robot: int, own: Submap, stars: Stars_, joined: Joined) -> Submap | None:
    """The map of the others' constellations that shares most with one's own."""
    parts = [part for constellation in stars.values() for part in constellation]
    gone = {part.id for part in stars[robot]}
    near = point_of(joined.map) if len(joined.components) == 1 else None
    try:
        maps = [component.map for component in without(parts, joined, gone, near=near, options=QUICK).components]
    except TeamslamError:
        return None
    return max(maps, key=lambda m: len(np.intersect1d(m.landmark_keys, own.landmark_keys)), default=None)


def _misfit(mine: Stars, theirs: Stars, dim: int) -> Array:
    """How far each landmark of a constellation is from where the map has it, in the frame that most agree on."""
    found = link(_outline(theirs), _outline(mine), dim == 2)
    off = np.zeros(len(mine.keys))
    places = assumed(None, mine, theirs)
    known = places >= 0
    d = mine.places.shape[-1]
    frame = found.frame.lift(d) if found.frame.dim < d else found.frame
    apart = np.sum((theirs.places[places[known]] - frame.act(mine.places[known])) ** 2, -1)
    off[known] = apart / (mine.variances[known] + theirs.variances[places[known]])
    return off


def _outline(stars: Stars) -> Outline:
    n, d = stars.places.shape
    places = np.concatenate([stars.places, np.zeros((n, 3 - d))], -1)
    none = np.zeros(n, bool)
    order = np.argsort(stars.keys)
    turns = np.tile(np.eye(3), (n, 1, 1))
    return Outline(stars.keys[order], places[order], turns, none, stars.variances[order], np.zeros(n), none)


def _joined(stars: Stars_, near: Values | None = None) -> Joined:
    parts = [part for own in stars.values() for part in own]
    if near is not None:
        return without(parts, Joined((Component(parts[0], None, ()),)), (), near=near, options=QUICK)
    return together(parts, join(parts, options=QUICK), QUICK)


def _gain(before: Fit, change: Change, stars: Stars_) -> float:
    """By how much likelier all constellations together are with a change."""
    try:
        after = fit_of(_changed(change, stars))
    except TeamslamError:
        return -np.inf
    return unlikely(before, before) - unlikely(before, after)


def _changed(change: Change, stars: Stars_) -> Joined:
    """All constellations joined with a change."""
    own = [renamed(part, change.names) for part in stars[change.robot]]
    return _joined({**stars, change.robot: own})


def _knows(parts: Sequence[Submap], change: Change) -> bool:
    return any(np.isin([change.one, change.other], part.landmark_keys).any() for part in parts)


def _apart(change: Change, joined: Joined) -> float:
    """How far a landmark is from where its name says, in the map with the change."""
    both = np.array([change.one, change.other])
    held = next((c.map for c in joined.components if np.isin(both, c.map.landmark_keys).all()), None)
    if held is None:
        return float("nan")
    places = held.values.positions(both, 3)
    return float(np.linalg.norm(places[0] - places[1]))
