"""Who is who where robots see each other: decided for the whole team at once, coarsely first.

    ways    the map of odometry and of sightings of robots alone: no landmark is needed to lay the ways in one frame
    cool    landmarks are told apart at a distance s, which falls from what the ways are uncertain by to what the
            sensors resolve; at each s the map is solved with every landmark known to s, so that it bends where it must
    tell    landmarks that stand closer than that, by what images show of them together (`mixture`), and the map with
            what is sure of it, in turns
    off     how wrong that map is about where an image was taken from is measured where it was not told: on images that
            are left out of it

What is kept is sure at 99 of 100 by that figure; the rest is of several landmarks. Where what comes of it is nothing
that images show, nothing is kept.

Source: Rose, "Deterministic annealing for clustering, compression, classification" (1998); Kulis, Jordan, "Revisiting
k-means" (ICML 2012), for landmarks that are born where none is near.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import full
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.joining.start.targets import place_targets
from teamslam.model import Dataset, Submap, Table, Values, chi2_quantile, is_pose, is_unnamed, point_kind
from teamslam.model.sparse import sp
from teamslam.solver import Covariances, Options, System, optimise
from teamslam.trust.associate.compatible import NONE, UNSURE
from teamslam.trust.associate.depth import straightened
from teamslam.trust.associate.mixture import FEWEST, told_apart
from teamslam.trust.associate.sensing import Seen, slopes

COOLER = 0.7  # of s, from step to step
WIDE = 3.0  # times the standard deviation of the ways, to begin with
REACH = 1.6  # times s: what is farther from all landmarks is of another
RESOLVED = 3.0  # times the usual standard deviation of a sighting: what is nearer is told apart closely
CLOSE = 2.5  # times s: landmarks that are nearer may have sightings of each other
SURE = 0.99
ROUNDS = 9
TAIL = 0.95  # of images, by the farthest of which the others are judged
BIRTHS = 100  # landmarks that are born at one distance, at most
HELD = 3  # of so many images one is left out, to see how far off the map is there
OFTEN, PAIRS = 10, 3  # sightings of a landmark, and pairs of these, that tell whether images show them together
TOGETHER = 0.05  # of the images of the one that is seen more seldom, that should show both
FIRST = 1 << 48  # keys of landmarks while nobody has named them
QUICK = Options(max_iterations=60, decrement=0.1)


@dataclass(frozen=True, eq=False)
class Cooled:
    """By robot, the landmark (m,) of each of its sightings that place one (`Seen.of`), by a number in the team: NONE
    where it is of none, UNSURE where of several; and all of them where the ways are too `rough` to tell any."""

    marks: dict[int, IntArray]
    rough: bool


def cooled(log: Dataset) -> Cooled | None:
    """The landmarks of a log in which none has a name. None where the ways do not hang together without landmarks, or
    where these are poses, or some have names.

    Law: sightings of one image are of different landmarks.
    """
    named = any((Seen.of(log, robot).labels >= 0).any() for robot in log.robots)
    return None if named or len(log.robots) < 2 else cooled_beside(log)


def cooled_beside(log: Dataset) -> Cooled | None:
    """The same of sightings without a name alone, beside landmarks that have one, where none of these is seen without:
    they tell the ways like all else. None where the ways do not hang together so, or where landmarks without a name are
    poses."""
    team = _Team.of(log)
    if team is None:
        return None
    marks = _told(team, *_coarse(team))
    rough = marks is None
    each = np.full(len(team.observers), UNSURE) if marks is None else marks
    ends = np.cumsum([len(seen) for seen in team.seen.values()])[:-1]
    return Cooled(dict(zip(team.seen, np.split(each, ends), strict=True)), rough)


@dataclass(frozen=True, eq=False)
class _Map:
    """Where robots were, and where every sighting puts its landmark (m, d); how its residual, in sigmas, follows the
    landmark (m, r, d)."""

    ways: Values
    places: Array
    slopes: Array

    @cached_property
    def spread(self) -> Array:
        """The covariance of the places by the sensors alone (m, d, d)."""
        return np.asarray(np.linalg.inv(np.swapaxes(self.slopes, 1, 2) @ self.slopes))


@dataclass(frozen=True, eq=False)
class _Team:
    """A log whose ways are known without its landmarks: by robot what it has `seen` of these, the rows of all else
    (`rest`), the ways that these alone say, what does not move, and by how much the ways are uncertain [m]."""

    log: Dataset
    seen: dict[int, Seen]
    rest: tuple[Table, ...]
    ways: Values
    fixed: IntArray
    uncertain: float

    @classmethod
    def of(cls, log: Dataset) -> "_Team | None":
        seen = {robot: Seen.of(log, robot) for robot in log.robots}
        seen = {robot: each.select(np.flatnonzero(each.labels < 0)) for robot, each in seen.items()}
        tables = [table for each in seen.values() for table in each.tables]
        rest = [t.select(np.flatnonzero(~is_unnamed(t.keys[:, -1]))) for t in log.tables]
        if not tables or any(table.row.targets_pose for table in tables):
            return None
        try:
            joined = full(log.with_tables(table for table in rest if len(table)))
        except SolveError:
            return None
        ways = point_of(joined.map)
        observers = np.concatenate([each.observers for each in seen.values()])
        if len(joined.components) > 1 or not ways.layout.contains(observers).all():
            return None
        used = tuple(table for table in rest if len(table) and ways.layout.contains(table.keys).all())
        return cls(log, seen, used, ways, frame_of(joined.map), _uncertain(joined.map))

    @cached_property
    def observers(self) -> IntArray:
        """From where every sighting was taken (m,)."""
        return np.concatenate([each.observers for each in self.seen.values()])

    @cached_property
    def images(self) -> IntArray:
        """The number (m,) of the image that every sighting is in."""
        return np.asarray(np.unique(self.observers, return_inverse=True)[1])

    def seen_from(self, ways: Values) -> _Map:
        """Where the sightings put their landmarks, as seen from some ways."""
        places, follow = [], []
        for each in (each for each in self.seen.values() if len(each)):
            own = np.concatenate([table.keys[:, 1] for table in each.tables])
            values = place_targets(ways, each.tables, self.log.layout)
            found = slopes(each.rows(np.arange(len(each)), own), values, len(each)).of_target
            places.append(values.positions(own, found.shape[2]))
            follow.append(found)
        return _Map(ways, np.concatenate(places), np.concatenate(follow))

    def straightened(self, map: _Map, marks: IntArray, landmarks: Array) -> "_Team":
        """The team with what is systematic taken out of its ranges, as the map has it."""
        ends = np.cumsum([0, *(len(each) for each in self.seen.values())])
        seen = {}
        for (robot, each), first in zip(self.seen.items(), ends.tolist(), strict=False):
            tables, at = [], first
            for table in each.tables:
                mine = marks[at : at + len(table)]
                at += len(table)
                there = landmarks[np.maximum(mine, 0)]
                eye = map.ways.poses_of(table.keys[:, 0], there.shape[1])
                eye = eye if table.sensor is None else eye @ table.sensor.lift(eye.dim)
                distance = np.linalg.norm(eye.unact(there), axis=1)
                tables.append(straightened(table, distance, mine >= 0))
            seen[robot] = replace(each, tables=tuple(tables))
        return replace(self, seen=seen)

    def solved(self, near: _Map, marks: IntArray, landmarks: Array, off: float) -> _Map:
        """The map with every sighting's landmark as `marks` (m,) say, -1 for none, known to `off` [m] beside what its
        sensor says; `landmarks` (n, d) to begin with."""
        tables, first = [], 0
        for each in self.seen.values():
            for table in each.tables:
                mine = marks[first : first + len(table)]
                follow = near.slopes[first : first + len(table)]
                first += len(table)
                rows = np.flatnonzero(mine >= 0)
                if len(rows):
                    keys = np.stack([table.keys[rows, 0], FIRST + mine[rows]], -1)
                    part = replace(table.select(rows), keys=keys)
                    tables.append(_blurred(part, follow[rows], off))
        known = np.unique(marks[marks >= 0])
        kind = point_kind(landmarks.shape[1])
        values = near.ways.update(Values.of({kind: (FIRST + known, landmarks[known])}))
        system = System(values.layout, tables=[*self.rest, *tables], fixed=self.fixed, names=self.log.names)
        found = optimise(system, values, QUICK).values
        return self.seen_from(found.only(self.ways.layout.keys))


def _blurred(table: Table, follow: Array, off: float) -> Table:
    """Sightings that know their landmark only to `off` in every direction beside what their sensor says; `follow`
    (m, r, d): how a residual in sigmas follows the landmark."""
    spread = np.eye(follow.shape[1]) + off**2 * follow @ np.swapaxes(follow, 1, 2)
    return replace(table, whitening=np.linalg.solve(np.linalg.cholesky(spread), table.whitening))


def _uncertain(map: Submap) -> float:
    """The largest standard deviation of a robot's place in a map [m]."""
    poses = map.values.layout.keys[is_pose(map.values.layout.keys)]
    blocks = Covariances.of_map(map).blocks(poses)
    return float(np.sqrt(max(np.trace(b[: len(b) // 2 + 1, : len(b) // 2 + 1]) for b in blocks)))


# --- coarsely ---------------------------------------------------------------------------------------------------------


def _coarse(team: _Team) -> tuple[_Map, IntArray, Array, float]:
    """Landmarks told apart as far as the sensors go: the map, the landmark of every sighting (m,), their places, and
    the distance s at which they were told."""
    map = team.seen_from(team.ways)
    resolved = RESOLVED * float(np.median(np.sqrt(np.trace(map.spread, axis1=1, axis2=2) / map.spread.shape[1])))
    s, landmarks = max(WIDE * team.uncertain, resolved / COOLER), np.median(map.places, 0)[None]
    while True:
        marks, landmarks = gathered(map.places, landmarks, REACH * s)
        map = team.solved(map, marks, landmarks, s)
        if s <= resolved:
            return map, marks, landmarks, s
        s *= COOLER


def gathered(places: Array, landmarks: Array, reach: float) -> tuple[IntArray, Array]:
    """The landmark of each of some places (m, d), and where they are: the means of what is nearest to them, one more
    wherever enough places are farther than `reach` from all. Law: landmarks have FEWEST places at least; what is
    farther than twice the reach from all is of none, -1."""
    for _ in range(BIRTHS):
        near, far = _nearest(places, landmarks)
        counts = np.bincount(near, minlength=len(landmarks))
        landmarks = np.array([np.median(places[near == n], 0) for n in np.flatnonzero(counts >= FEWEST)])
        away = places[far > reach]
        born = _densest(away, 0.5 * reach)
        if born is not None:
            landmarks = np.concatenate([landmarks, born[None]])
        elif (counts >= FEWEST).all():
            break
    near, far = _nearest(places, landmarks)
    return np.where(far <= 2.0 * reach, near, -1), landmarks


def _nearest(places: Array, landmarks: Array) -> tuple[IntArray, Array]:
    from scipy.spatial import cKDTree

    far, near = cKDTree(landmarks).query(places)
    return np.asarray(near), np.asarray(far)


def _densest(places: Array, reach: float) -> Array | None:
    """Where most places are within reach of one of them; None where these are too few."""
    from scipy.spatial import cKDTree

    if len(places) < FEWEST:
        return None
    tree = cKDTree(places)
    around = [np.array(near) for near in tree.query_ball_point(places, reach)]
    most = max(around, key=len)
    return np.asarray(np.median(places[most], 0)) if len(most) >= FEWEST else None


# --- closely ----------------------------------------------------------------------------------------------------------


def _told(raw: _Team, map: _Map, marks: IntArray, landmarks: Array, s: float) -> IntArray | None:
    """The landmark of every sighting (m,), UNSURE where it may be of several, NONE where of none; None where what comes
    of it is nothing that images show."""
    off = s
    for _ in range(ROUNDS):
        if not len(landmarks):
            return np.full(len(marks), NONE)
        team = raw.straightened(map, marks, landmarks)
        map = team.seen_from(map.ways)
        marks, sure, landmarks = _members(team, map, marks, landmarks, off, CLOSE * s)
        kept = np.where(sure, marks, -1)
        held = _off(team, map, kept, landmarks, off)
        map = team.solved(map, kept, landmarks, off)
        off = max(COOLER * off, held)
    if _are_ghosts(map.places, np.where(sure, marks, -1), landmarks, team.images):
        return None
    return np.where(sure, marks, np.where(marks < 0, NONE, UNSURE))


def _are_ghosts(places: Array, marks: IntArray, landmarks: Array, images: IntArray) -> bool:
    """Whether landmarks stand nearer to each other than what images show, and yet hardly any image shows two of them:
    then they are the same few, seen from ways that do not lie as the map has them. `places` (m, d), `marks` and
    `images` (m,): of sightings; `landmarks` (n, d)."""
    from scipy.spatial import cKDTree

    apart = _within_images(places, images)
    if not len(apart) or not len(landmarks):
        return False
    told = marks >= 0
    shape = (int(images.max()) + 1, len(landmarks))
    shows = sp.csr_array((np.ones(np.count_nonzero(told)), (images[told], marks[told])), shape=shape)
    together = (shows.T @ shows).toarray()
    often = np.diag(together)
    pairs = cKDTree(landmarks).query_pairs(0.5 * float(np.median(apart)), output_type="ndarray")
    pairs = pairs[(often[pairs] >= OFTEN).all(1)]
    if len(pairs) < PAIRS:
        return False
    shares = together[pairs[:, 0], pairs[:, 1]] / often[pairs].min(1)
    return bool(np.mean(shares < TOGETHER) > 0.5)


def _within_images(places: Array, images: IntArray) -> Array:
    """How far apart [m] the two nearest sightings of each image are, of those images that have several."""
    from scipy.spatial.distance import pdist

    order = np.argsort(images, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(images[order])) + 1)
    return np.array([float(pdist(places[group]).min()) for group in groups if len(group) > 1])


def _members(
    team: _Team, map: _Map, marks: IntArray, landmarks: Array, off: float, close: float
) -> tuple[IntArray, BoolArray, Array]:
    """Of every sighting its landmark (m,), whether that is sure, and where the landmarks are."""
    out, sure, found, count = np.full(len(marks), -1), np.zeros(len(marks), bool), [landmarks[:0]], 0
    for group in _groups(landmarks, close):
        rows = np.flatnonzero(np.isin(marks, group))
        if len(rows) < FEWEST:
            continue
        told = told_apart(map.places[rows], map.spread[rows], team.images[rows], off)
        likeliest = told.odds.argmax(1)
        none = likeliest == len(told.places)
        out[rows] = np.where(none, -1, likeliest + count)
        sure[rows] = ~none & (told.odds.max(1) >= SURE)
        found.append(told.places)
        count += len(told.places)
    return out, sure, np.concatenate(found)


def _groups(landmarks: Array, close: float) -> Iterator[IntArray]:
    """Landmarks that chains of neighbours closer than so join."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    tree = cKDTree(landmarks)
    _, label = connected_components(tree.sparse_distance_matrix(tree, close))
    for group in np.unique(label).tolist():
        yield np.flatnonzero(label == group)


def _off(team: _Team, map: _Map, marks: IntArray, landmarks: Array, off: float) -> float:
    """How far off the map is [m], in each direction, about the pose of an image that it was not told: as the farthest
    twentieth of images are that show several landmarks and were left out."""
    several = np.bincount(team.images, marks >= 0) >= 2
    number = np.cumsum(several) - 1
    out = (several & (number % HELD == 0))[team.images]
    without = team.solved(map, np.where(out, -1, marks), landmarks, off)
    rows = np.flatnonzero(out & (marks >= 0))
    if not len(rows):
        return off
    apart = without.places[rows] - landmarks[marks[rows]]
    _, image = np.unique(team.images[rows], return_inverse=True)
    mean = np.stack([np.bincount(image, a) for a in apart.T], 1) / np.bincount(image)[:, None]
    return float(np.sqrt(np.quantile(np.sum(mean**2, 1), TAIL) / chi2_quantile(TAIL, apart.shape[1])))
