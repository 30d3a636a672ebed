"""Who is who in a team's log where sightings of landmarks have no names: decided before anything is joined.

    by names  where most sightings have one, the others by the map of these                              (`by_names`)
    cooled    where robots see each other, and no landmark has a name, the team at once, coarsely first   (`cooling`);
              what that leaves open, by the map of what it told

and else

    within   each piece of a robot's log alone: sightings become landmarks of its own      (`within`)
    across   maps are matched by their constellations, the surest first; what is matched is joined and matched again, so
             that what two maps leave open the third may decide; what stays open is told with its odds      (`across`)
    again    with the team's map every sighting is judged anew: what a robot could not tell alone, others may

What comes out is a log in which every sighting that is kept names its landmark; `join` takes that as given.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray, Pose
from teamslam.joining import join, split
from teamslam.model import Dataset, Dropped, Kind, Names, Submap, Table, is_landmark, is_unnamed
from teamslam.solver import Covariances
from teamslam.trust.associate.across import Constellation, Motion, motions
from teamslam.trust.associate.by_names import by_names, told_again
from teamslam.trust.associate.compatible import NONE, UNSURE
from teamslam.trust.associate.cooling import cooled
from teamslam.trust.associate.sensing import Seen
from teamslam.trust.associate.within import CONFIRMED, FIRST, Own, Prior, again_with, judged, map_of, relabelled, within

SURE = 0.99  # odds from which maps are taken to lie so
ROUNDS = 3
START_M, START_RAD = 0.3, 0.1  # how well constellations tell where a robot's way begins
ROUGH = (
    "landmarks without names could not be told from each other: without them it is known too roughly where the robots "
    "were, and what was laid in one frame stands nearer than images show it; names for some of them, or more sightings "
    "of robots, would tell"
)
PIECE = 1 << 20  # landmarks that one piece may have


@dataclass(frozen=True, eq=False)
class Rivals:
    """Two groups of robots whose maps could not be matched for sure: the ways in which they may lie, and their odds."""

    robots: tuple[tuple[int, ...], tuple[int, ...]]
    motions: tuple[Motion, ...]
    sentence: str


@dataclass(frozen=True, eq=False)
class Associated:
    """A log in which sightings name their landmarks.

    `dataset`: the log; sightings that could be of several landmarks, or of none, are left out and counted in `dropped`.
    `landmarks`: how many were found without a name. `rivals`: what stays open between maps, in words and odds.
    """

    dataset: Dataset
    landmarks: int
    unsure: int
    strangers: int
    rivals: tuple[Rivals, ...]


def associate(dataset: Dataset, tell: Callable[[int, int], None] = lambda done, of: None) -> Associated:
    """Names for the landmarks of a log, where sightings have none (`teamslam.model.is_unnamed`).

    Sightings with names keep them, and lend them to what is the same. A log in which all have names is returned as it
    is. Law: sightings of one image are of different landmarks. Bearings and ranges alone place nothing, and are judged
    by nobody: without a name they are left out. `tell` hears how far this is, and of how much.
    """
    bare = sum(int(is_unnamed(table.keys[:, -1]).sum()) for table in dataset.tables)
    if not bare:
        return Associated(dataset, 0, 0, 0, ())
    if (told := by_names(dataset, tell)) is not None:
        pieces = [_Piece.told(dataset, robot, marks) for robot, marks in told.items()]
        return _named(dataset, pieces, (), {key: key for key in _names_of(dataset)})
    team = cooled(dataset)
    if team is not None:
        if team.rough:
            dataset = replace(dataset, notes=(*dataset.notes, ROUGH))
        known = team.marks if team.rough else told_again(dataset, team.marks)
        return _named(dataset, [_Piece.told(dataset, robot, marks) for robot, marks in known.items()], ())
    pieces = _alone(split(dataset), tell)
    pieces, rivals, scale = _together(pieces)
    for _ in range(ROUNDS):
        again = _again(pieces, scale)
        if all(np.array_equal(a.marks, b.marks) for a, b in zip(again, pieces, strict=True)):
            break
        pieces = again
    return _named(dataset, pieces, rivals)


@dataclass(frozen=True, eq=False)
class _Piece:
    """A piece of a log with the landmark of each sighting, by a number of its own in the team (m,), and labels."""

    log: Dataset
    robot: int
    own: Own
    marks: IntArray
    submap: Submap | None

    @classmethod
    def of(cls, number: int, log: Dataset, tell: Callable[[int, int], None]) -> "_Piece":
        """A piece that knows only of itself."""
        robot = log.tables[0].robot
        own = within(log, robot, tell)
        marks = np.where(own.marks >= 0, own.marks + PIECE * number, own.marks)
        return cls(log, robot, own, marks, None).solved()

    @classmethod
    def told(cls, team: Dataset, robot: int, marks: IntArray) -> "_Piece":
        """What a robot saw, of which the team has told the landmarks."""
        log = team.with_tables(table for table in team.tables if table.robot == robot)
        return cls(log, robot, Own(Seen.of(log, robot), marks, {}, None), marks, None)

    def solved(self) -> "_Piece":
        """With the map of its landmarks as they are now."""
        return replace(self, submap=map_of(self.log, self.own.seen, self.marks) if (self.marks >= 0).any() else None)


def _alone(parts: list[Dataset], tell: Callable[[int, int], None]) -> list[_Piece]:
    """Pieces of which each knows only of itself; `tell` hears how many poses of all are done."""
    poses = [sum(map(len, part.pose_keys.values())) for part in parts]
    pieces = []
    for n, part in enumerate(parts):
        before = sum(poses[:n])
        pieces.append(_Piece.of(n, part, lambda done, of, before=before: tell(before + done, sum(poses))))  # type: ignore[misc]
    return pieces


def _labels(pieces: list[_Piece]) -> dict[int, int]:
    """The label of each landmark that has one: what most of its sightings in the team say."""
    votes: dict[int, dict[int, int]] = {}
    for piece in pieces:
        named = (piece.marks >= 0) & (piece.own.seen.labels >= 0)
        for mark, label in zip(piece.marks[named].tolist(), piece.own.seen.labels[named].tolist(), strict=True):
            said = votes.setdefault(mark, {})
            said[label] = said.get(label, 0) + 1
    return {mark: max(said, key=lambda label: (said[label], -label)) for mark, said in votes.items()}


# --- across -----------------------------------------------------------------------------------------------------------


def _together(pieces: list[_Piece]) -> tuple[list[_Piece], tuple[Rivals, ...], float]:
    """Pieces whose common landmarks have common numbers, as far as that is sure; what is not; and how many times larger
    than stated the errors of maps look."""
    scale = 1.0
    groups = [[n] for n, piece in enumerate(pieces) if piece.submap is not None]
    known: dict[tuple[tuple[int, ...], tuple[int, ...]], list[Motion]] = {}
    while True:
        maps = {tuple(group): _map([pieces[n] for n in group]) for group in groups}
        for one, other in combinations(sorted(maps), 2):
            if (one, other) not in known:
                labels = {FIRST + mark: label for mark, label in _labels(pieces).items()}
                both = [pieces[n] for n in (*one, *other)]
                known[one, other] = _matches(maps[one], maps[other], labels, _map(both))
        here = {pair: found for pair, found in known.items() if pair[0] in maps and pair[1] in maps and found}
        sure = {pair: found for pair, found in here.items() if found[0].odds >= SURE}
        best = max(sure, key=lambda pair: sure[pair][0].evidence, default=None)
        if best is None:
            return pieces, tuple(_rivals(pieces, *found) for found in sorted(here.items())), scale
        one, other = best
        united = _united(pieces, maps, one, other, here[best][0])
        if _map([united[n] for n in (*one, *other)]) is None:
            known[best] = []  # their join does not hold
            continue
        pieces, scale = united, max(scale, here[best][0].scale)
        groups = [g for g in groups if tuple(g) not in best] + [sorted((*one, *other))]


def _united(
    pieces: list[_Piece],
    maps: dict[tuple[int, ...], Submap | None],
    one: tuple[int, ...],
    other: tuple[int, ...],
    motion: Motion,
) -> list[_Piece]:
    """The pieces with those of one group told anew among those of the other: the larger, or surer of its own."""
    pose = motion.pose
    if (len(other), _sureness(pieces, other)) > (len(one), _sureness(pieces, one)):
        one, other, pose = other, one, pose.inverse()
    map, theirs = maps[one], maps[other]
    assert map is not None and theirs is not None
    out, labels = list(pieces), _labels(pieces)
    for n in other:
        piece = pieces[n]
        assert piece.submap is not None
        start = pose.lift(theirs.all_values.pose(piece.submap.first_pose).dim) if pose.dim == 2 else pose
        start = start @ theirs.all_values.pose(piece.submap.first_pose)
        prior = _prior(map, start, piece, motion.scale)
        marks = again_with(piece.log, piece.robot, piece.own.seen, prior, labels)
        fresh = marks > prior.numbers.max()
        marks = np.where(fresh, marks - int(prior.numbers.max()) - 1 + PIECE * (n + len(pieces)), marks)
        rare = [m for m, c in zip(*np.unique(marks[fresh], return_counts=True), strict=True) if c < CONFIRMED]
        out[n] = replace(piece, marks=np.where(np.isin(marks, rare), NONE, marks)).solved()
    return out


def _sureness(pieces: list[_Piece], group: tuple[int, ...]) -> float:
    """The share of a group's sightings of which it is sure whose they are."""
    return float(np.mean(np.concatenate([pieces[n].marks for n in group]) >= 0))


def _prior(map: Submap, start: Pose, piece: _Piece, scale: float) -> Prior:
    """What a map tells of its landmarks to a robot that begins at `start`, give or take a step among them."""
    keys = map.landmark_keys[map.landmark_keys >= FIRST]
    kind = Kind(int(map.values.layout.kinds[map.values.layout.index(keys[:1])][0]))
    covariance = scale**2 * Covariances.of_map(map).joint(keys)
    dim = piece.log.robots[piece.robot]
    pose = Pose(start.rotation[None, :dim, :dim], start.translation[None, :dim])
    sigma = np.concatenate([np.full(dim, START_M), np.full(pose.dof - dim, START_RAD)])
    return Prior(keys - FIRST, map.values.gather(keys, kind), covariance, pose, sigma)


def _matches(one: Submap | None, other: Submap | None, labels: dict[int, int], both: Submap | None) -> list[Motion]:
    """The ways in which two maps may lie to each other; `both`: their map together, where something holds it."""
    if one is None or other is None or min(len(one.landmark_keys), len(other.landmark_keys)) < 2:
        return []
    known = None
    if both is not None and both.all_values.layout.contains(np.array([one.base, other.base])).all():
        known = both.all_values.pose(one.base).between(both.all_values.pose(other.base))
    return motions(Constellation.of(one, labels), Constellation.of(other, labels), known)


def _map(pieces: list[_Piece]) -> Submap | None:
    """The map of some pieces together; None where they do not hang together as one."""
    submaps = [piece.submap for piece in pieces if piece.submap is not None]
    if len(submaps) == 1:
        return submaps[0]
    try:
        joined = join(submaps)
    except SolveError:
        return None
    return joined.map if len(joined.components) == 1 else None


def _rivals(pieces: list[_Piece], pair: tuple[tuple[int, ...], tuple[int, ...]], found: list[Motion]) -> Rivals:
    one, other = (tuple(sorted({pieces[n].robot for n in group})) for group in pair)
    names = pieces[0].log.names
    who = " and ".join(f"robot{'s' * (len(g) > 1)} {', '.join(map(names.robot, g))}" for g in (one, other))
    ways = ", ".join(f"{len(motion.pairs)} landmarks in common at {motion.odds:.0%}" for motion in found)
    rest = 1.0 - sum(motion.odds for motion in found)
    return Rivals(
        (one, other), tuple(found), f"{who} may lie to each other so: {ways}; or have nothing in common, {rest:.0%}"
    )


# --- again ------------------------------------------------------------------------------------------------------------


def _again(pieces: list[_Piece], scale: float) -> list[_Piece]:
    """Every sighting judged by the map of all that hangs together with its robot."""
    labels = _labels(pieces)
    out = list(pieces)
    for map, members in _components(pieces):
        known = map.landmark_keys[map.landmark_keys >= FIRST] - FIRST
        seen = np.concatenate([pieces[n].marks for n in members])
        often = np.array([np.count_nonzero(seen == mark) for mark in known])
        for n in members:
            piece = pieces[n]
            marks = judged(piece.own.seen, piece.marks, map, known, labels, often, scale)
            out[n] = replace(piece, marks=marks)
    counts: dict[int, int] = {}
    for piece in out:
        for mark, count in zip(*np.unique(piece.marks[piece.marks >= 0], return_counts=True), strict=True):
            counts[int(mark)] = counts.get(int(mark), 0) + int(count)
    rare = [mark for mark, count in counts.items() if count < CONFIRMED]
    return [replace(p, marks=np.where(np.isin(p.marks, rare), NONE, p.marks)).solved() for p in out]


def _components(pieces: list[_Piece]) -> Iterator[tuple[Submap, list[int]]]:
    """The maps that the pieces make, each with the numbers of its pieces."""
    numbers = [n for n, piece in enumerate(pieces) if piece.submap is not None]
    submaps = [piece.submap for piece in pieces if piece.submap is not None]
    if not submaps:
        return
    for component in join(submaps).components:
        yield component.map, [n for n, s in zip(numbers, submaps, strict=True) if s.id in component.members]


# --- names ------------------------------------------------------------------------------------------------------------


def _names_of(dataset: Dataset) -> list[int]:
    """The landmarks that sightings name."""
    targets = np.unique(np.concatenate([table.keys[:, -1] for table in dataset.tables]))
    return [int(key) for key in targets[is_landmark(targets) & ~is_unnamed(targets)]]


def _named(
    dataset: Dataset, pieces: list[_Piece], rivals: tuple[Rivals, ...], labels: dict[int, int] | None = None
) -> Associated:
    """The log with its landmarks named: by their `labels` where they have any (None: what their sightings say), else by
    their first sighting."""
    labels = _labels(pieces) if labels is None else labels
    first: dict[int, int] = {}
    lent = unsure = strangers = 0
    for piece in pieces:
        keys = np.array([piece.log.tables[a].keys[b, 1] for a, b in piece.own.seen.origin.tolist()], np.int64)
        for mark, key in zip(piece.marks.tolist(), keys.tolist(), strict=True):
            if mark >= 0:
                first[mark] = min(first.get(mark, key), key)
        bare = piece.own.seen.labels < 0
        lent += int((bare & np.isin(piece.marks, list(labels))).sum())
        unsure += int((bare & (piece.marks == UNSURE)).sum())
        strangers += int((bare & (piece.marks == NONE)).sum())
    names = {mark: labels.get(mark, key) for mark, key in first.items()}
    found = sorted({key for mark, key in names.items() if mark not in labels})
    tables = []
    for piece in pieces:
        seen, marks = piece.own.seen, piece.marks
        named = np.array([names.get(mark, mark) for mark in marks.tolist()], np.int64).reshape(-1)
        keys = np.where(seen.labels >= 0, seen.labels, named)
        tables += [_without_bare(table, found) for table in relabelled(piece.log, seen, keys).tables]
    called = {key: f"unnamed {n}" for n, key in enumerate(found, start=1)}
    kept = dataset.with_tables(t for t in tables if len(t))
    lost = sum(len(t) for t in dataset.tables) - sum(len(t) for t in kept.tables) - unsure - strangers
    dropped = [
        Dropped(count, reason)
        for count, reason in (
            (unsure, "sightings without a name that may be of several landmarks"),
            (strangers, "sightings without a name that are of no landmark that was seen often enough"),
            (lost, "sightings without a name that do not place what they saw"),
        )
        if count
    ]
    kept = replace(
        kept,
        names=Names(dataset.names.robots, {**dataset.names.landmarks, **called}, dataset.names.tick_s),
        dropped=(*dataset.dropped, *dropped),
        notes=(*dataset.notes, *_notes(len(found), lent, rivals)),
    )
    return Associated(kept, len(found), unsure, strangers, rivals)


def _notes(found: int, lent: int, rivals: tuple[Rivals, ...]) -> Iterator[str]:
    if lent:
        yield f"{lent} sighting{'s' * (lent != 1)} without a name {'is' if lent == 1 else 'are'} of landmarks with one"
    if found or not lent:
        yield f"{found} landmark{'s' * (found != 1)} found in sightings without a name"
    for rival in rivals:
        yield rival.sentence


def _without_bare(table: Table, found: list[int]) -> Table:
    """A table without sightings of unnamed landmarks that are none."""
    target = table.keys[:, -1]
    return table.select(np.flatnonzero(~(is_landmark(target) & is_unnamed(target)) | np.isin(target, found)))
