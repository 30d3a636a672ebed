"""Who is who along one robot's way: sightings grouped into landmarks of its own.

forward   a filter goes along the way: each image's sightings are matched by joint compatibility, become new landmarks
          where they fit none, or stay open where they fit two
drop      landmarks that were seen too seldom are false alarms until somebody says otherwise
again     with the robot's own least squares map, every sighting is judged anew, those left open too, by where the
          whole way says it was; landmarks that the sensor cannot tell apart, and that no image shows together, are
          one; until nothing changes
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.joining import build
from teamslam.joining.start.dead_reckoning import own_chain
from teamslam.joining.start.odometry import odometry_links
from teamslam.joining.start.targets import measured_poses
from teamslam.model import Dataset, Kind, Submap, Values, landmark_key
from teamslam.trust.associate.compatible import NEW, NONE, UNSURE, Reading, gate, matched, readings
from teamslam.trust.associate.filter import HERE, Filter, Innovations
from teamslam.trust.associate.joint import Joint
from teamslam.trust.associate.sensing import Seen, slopes
from teamslam.trust.associate.splitting import in_two

LOST = 60.0  # a story that is so much less likely (-2 log) than the best is not followed
STORIES = 8  # ways to read the log that are followed at a time
CONFIRMED = 3  # sightings that make a landmark
ROUNDS = 12
FIRST = 1 << 48  # numbers of landmarks while they are a robot's own


@dataclass(frozen=True, eq=False)
class Own:
    """One piece's sightings (`seen`) and the landmark of each (`marks` (m,), NONE where it is of none, UNSURE where of
    several), with their labels by landmark, and the piece's `submap` of them, None where no map came of it."""

    seen: Seen
    marks: IntArray
    labels: dict[int, int]
    submap: Submap | None


def within(piece: Dataset, robot: int, tell: Callable[[int, int], None] = lambda done, of: None) -> Own:
    """The landmarks of one robot's piece of log. `tell` hears of how many poses, of how many, the sightings were read.

    Law: sightings of one image are of different landmarks; sightings of one label are of one landmark.
    """
    seen = Seen.of(piece, robot)
    if not len(seen):
        return Own(seen, np.zeros(0, np.int64), {}, None)
    marks = dropped(_forward(piece, robot, seen, tell=tell))
    for _ in range(ROUNDS):
        submap = map_of(piece, seen, marks)
        if submap is None:
            return Own(seen, marks, labels_of(seen, marks), None)
        parted = divided(seen, marks, submap)
        if (parted != marks).any():
            marks = parted
            continue
        known = np.unique(marks[marks >= 0])
        often = np.array([np.count_nonzero(marks == mark) for mark in known])
        again = dropped(_merged(seen, judged(seen, marks, submap, known, labels_of(seen, marks), often), submap))
        if np.array_equal(again, marks):
            break
        marks = again
    return Own(seen, marks, labels_of(seen, marks), map_of(piece, seen, marks))


# --- forward ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Story:
    """One way to read a log so far: the belief, which landmark each sighting is of (m,), labels, -2 log likelihood."""

    state: Filter
    marks: IntArray
    labels: dict[int, int]
    cost: float


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before a way is looked at: landmarks by `numbers` (n,), `places` of one kind, their `covariance`,
    and the pose (1,) that the way begins with, to `sigma` of each of its unknowns."""

    numbers: IntArray
    places: Pose | Array
    covariance: Array
    pose: Pose
    sigma: Array

    def begun(self, kind: Kind) -> Filter:
        """The belief to begin with."""
        state = Filter(self.pose.dim, kind)
        n = self.pose.dof
        state.pose, state.marks, state.count = self.pose, self.places, len(self.numbers)
        state.covariance = np.zeros((n + len(self.covariance),) * 2)
        state.covariance[:n, :n] = np.diag(self.sigma**2)
        state.covariance[n:, n:] = self.covariance
        return state


def again_with(piece: Dataset, robot: int, seen: Seen, prior: Prior, labels: dict[int, int]) -> IntArray:
    """A way told anew among landmarks that others know: the number of each sighting's landmark (m,), those of new ones
    after all known numbers."""
    names = {n: labels[int(number)] for n, number in enumerate(prior.numbers) if int(number) in labels}
    marks = _forward(piece, robot, seen, prior.begun(_kind(piece)), names)
    known = len(prior.numbers)
    numbered = np.append(prior.numbers, 0)[np.minimum(np.maximum(marks, 0), known)]
    fresh = int(prior.numbers.max(initial=-1)) + 1 + marks - known
    return np.where(marks < 0, marks, np.where(marks < known, numbered, fresh))


def _forward(
    piece: Dataset,
    robot: int,
    seen: Seen,
    state: Filter | None = None,
    labels: dict[int, int] | None = None,
    tell: Callable[[int, int], None] = lambda done, of: None,
) -> IntArray:
    """The most likely story, of some that are followed side by side: decisions wait for what comes after."""
    chain = own_chain(piece, robot)
    which, row, backward = odometry_links(piece, robot, chain)
    dim = piece.robots[robot]
    state = Filter(dim, _kind(piece)) if state is None else state
    stories = [_Story(state, np.full(len(seen), NONE), labels or {}, 0.0)]
    order = np.argsort(seen.observers, kind="stable")
    images = np.split(order, np.flatnonzero(np.diff(seen.observers[order])) + 1)
    at_pose = {int(seen.observers[image[0]]): image for image in images}
    here, new = _from_here(seen), seen.cells
    for step, pose in enumerate(chain.tolist()):
        tell(step, len(chain))
        if step and which[step - 1] >= 0:
            moved = _step(piece, int(which[step - 1]), int(row[step - 1]), bool(backward[step - 1]), dim)
            for story in stories:
                story.state.move(*moved)
        if pose in at_pose:
            told = [after for story in stories for after in _look(story, seen, here, at_pose[pose], new)]
            stories = _kept(told)
    return min(stories, key=lambda story: story.cost).marks


def _kept(stories: list[_Story]) -> list[_Story]:
    """The likeliest stories, the best with every number of landmarks first: whether something is new shows late."""
    stories = sorted(stories, key=lambda story: story.cost)
    likely = [story for story in stories if story.cost < stories[0].cost + LOST]
    first: dict[int, int] = {}
    rank = []
    for n, story in enumerate(likely):
        first[story.state.count] = first.get(story.state.count, -1) + 1
        rank.append((first[story.state.count], n))
    return [likely[n] for _, n in sorted(rank)[:STORIES]]


def _kind(piece: Dataset) -> Kind:
    layout = piece.layout
    return Kind(int(layout.kinds[layout.index(piece.landmark_keys[:1])][0]))


def _step(piece: Dataset, which: int, row: int, backward: bool, dim: int) -> tuple[Pose, Array]:
    table = piece.tables[which].select(np.array([row]))
    step = measured_poses(table, dim)
    W = table.whitening[0]
    noise = np.linalg.inv(W.T @ W + 1e-12 * np.trace(W.T @ W) * np.eye(len(W)))
    return (step.inverse() if backward else step), noise


def _look(story: _Story, seen: Seen, here: Seen, image: IntArray, new: Array) -> Iterator[_Story]:
    """The story with one more image, in each likely reading of it."""
    count = story.state.count
    if count:
        pairs, which = _pairs(story.state, here, image, count)
        found = readings(pairs, which, _may(seen.labels[image[which]], pairs.targets, story.labels), new[image])
    else:
        pairs, found = None, [Reading(np.full(len(image), NEW), float(new[image].sum()))]
    for reading in found:
        state, labels, marks = copy(story.state), dict(story.labels), story.marks.copy()
        if pairs is not None and reading.shares:
            state.update(pairs, reading.shares)
        for place, pair in zip(image.tolist(), reading.pairs.tolist(), strict=True):
            if pair >= 0 and pairs is not None:
                marks[place] = pairs.targets[pair]
            else:
                marks[place] = state.add(here.rows(np.array([place]), np.array([0]))[0][1]) if pair == NEW else pair
            if marks[place] >= 0 and seen.labels[place] >= 0:
                labels[int(marks[place])] = int(seen.labels[place])
        yield _Story(state, marks, labels, story.cost + reading.cost)


def _pairs(state: Filter, here: Seen, image: IntArray, marks: int) -> tuple[Innovations, IntArray]:
    """Every sighting of an image with every landmark, and which sighting each pair is of."""
    which, targets = np.repeat(np.arange(len(image)), marks), np.tile(np.arange(marks), len(image))
    return state.seen(here.rows(image[which], targets), targets), which


def _may(label: IntArray, target: IntArray, labels: dict[int, int]) -> BoolArray:
    """Whether a sighting with a label (-1: none) may be of a landmark: no two labels are one landmark, no two landmarks
    have one label."""
    own = np.array([labels.get(t, -1) for t in range(int(target.max(initial=0)) + 1)])
    taken = np.isin(label, own) & (label >= 0)
    return np.where(label < 0, True, np.where(taken, own[target] == label, own[target] < 0))


def _from_here(seen: Seen) -> Seen:
    """The same sightings, all from one pose."""
    tables = tuple(replace(t, keys=np.stack([np.full(len(t), HERE), t.keys[:, 1]], -1)) for t in seen.tables)
    return Seen(tables, np.full(len(seen), HERE), seen.labels, seen.origin)


# --- again ------------------------------------------------------------------------------------------------------------


def dropped(marks: IntArray) -> IntArray:
    """Numbers counted through, without landmarks that were seen too seldom."""
    known, count = np.unique(marks[marks >= 0], return_counts=True)
    kept = known[count >= CONFIRMED]
    out = np.where(np.isin(marks, kept), np.searchsorted(kept, marks), np.where(marks == UNSURE, UNSURE, NONE))
    return np.asarray(out)


def relabelled(piece: Dataset, seen: Seen, keys: IntArray) -> Dataset:
    """The log with the sightings of each landmark under its key (m,); those with a key below 0 are left out."""
    tables = []
    for place, table in enumerate(piece.tables):
        mine = seen.origin[:, 0] == place
        if not mine.any():
            tables.append(table)
            continue
        target, kept = table.keys[:, 1].copy(), np.ones(len(table), bool)
        target[seen.origin[mine, 1]] = np.maximum(keys[mine], 0)
        kept[seen.origin[mine, 1]] = keys[mine] >= 0
        tables.append(replace(table, keys=np.stack([table.keys[:, 0], target], -1)).select(np.flatnonzero(kept)))
    return piece.with_tables(t for t in tables if len(t))


def map_of(piece: Dataset, seen: Seen, marks: IntArray) -> Submap | None:
    keys = np.where(marks >= 0, landmark_key(FIRST + np.maximum(marks, 0)), -1)
    try:
        return build(relabelled(piece, seen, keys))
    except SolveError:
        return None


def judged(
    seen: Seen,
    marks: IntArray,
    submap: Submap,
    known: IntArray,
    labels: dict[int, int],
    often: IntArray,
    scale: float = 1.0,
) -> IntArray:
    """Every sighting anew, by the whole way, image by image: of which of the landmarks `known` in a map it is.

    `often` they were seen so far: what is seen often is likelier to be seen again. `scale`: times the stated errors
    that the map may have.
    """
    values = submap.all_values
    often = often[values.layout.contains(FIRST + known)]
    known = known[values.layout.contains(FIRST + known)]
    posed = np.flatnonzero(values.layout.contains(seen.observers))
    if not len(known) or not len(posed):
        return marks
    numbered = {n: labels[int(mark)] for n, mark in enumerate(known) if int(mark) in labels}
    joint = Joint(submap, FIRST + known, seen.observers[posed])
    out = marks.copy()
    order = posed[np.argsort(seen.observers[posed], kind="stable")]
    for image in np.split(order, np.flatnonzero(np.diff(seen.observers[order])) + 1):
        which = np.repeat(np.arange(len(image)), len(known))
        targets = np.tile(np.arange(len(known)), len(image))
        found = slopes(seen.rows(image[which], FIRST + known[targets]), values, len(which))
        covariance = scale**2 * joint.with_pose(int(seen.observers[image[0]]), found.of_pose.shape[2])
        pairs = Innovations(found, targets, covariance, -2.0 * np.log(np.maximum(often, 1)[targets]))
        best = matched(pairs, which, _may(seen.labels[image[which]], targets, numbered))
        out[image] = np.where(best >= 0, known[targets[np.maximum(best, 0)]], best)
    return out


def divided(seen: Seen, marks: IntArray, submap: Submap) -> IntArray:
    """Landmarks that are two, as two."""
    values = submap.all_values
    out, fresh = marks.copy(), int(marks.max(initial=-1)) + 1
    labels = labels_of(seen, marks)
    posed = values.layout.contains(seen.observers)
    for mark in np.unique(marks[marks >= 0]).tolist():
        places = np.flatnonzero((marks == mark) & posed)
        if mark in labels or not len(places) or not values.layout.contains(FIRST + mark):
            continue
        found = slopes(seen.rows(places, np.full(len(places), FIRST + mark)), values, len(places))
        spread = np.broadcast_to(np.eye(found.error.shape[1]), (len(places), *(found.error.shape[1],) * 2))
        other = in_two(found.error, found.of_target, 1.5 * spread)
        if other is not None:
            out[places[other if other.sum() * 2 <= len(other) else ~other]] = fresh
            fresh += 1
    return out


def _merged(seen: Seen, marks: IntArray, submap: Submap) -> IntArray:
    """Landmarks that are one: no image shows both, their labels do not differ, and where they were seen from, the
    sensor cannot tell them apart."""
    values = submap.all_values
    labels = labels_of(seen, marks)
    known = np.unique(marks[marks >= 0])
    known = known[values.layout.contains(FIRST + known)]
    images: dict[int, set[int]] = {int(m): set(seen.observers[marks == m].tolist()) for m in known}
    if len(known) < 2:
        return marks
    dim = 2 + int((values.layout.kinds % 2).max())
    places = values.positions(FIRST + known, dim)
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    out = marks.copy()
    for i, j in sorted(zip(*np.nonzero(np.triu(apart > 0.0, 1)), strict=True), key=lambda p: float(apart[p])):
        a, b = int(known[i]), int(known[j])
        if images[a] & images[b] or len({labels[m] for m in (a, b) if m in labels}) > 1:
            continue
        if apart[i, j] > np.sort(apart[i])[min(3, len(known) - 1)] + np.sort(apart[j])[min(3, len(known) - 1)]:
            continue
        if _alike(seen, marks, a, b, values):
            out[out == b] = a
            images[a] |= images[b]
            images[b] = images[a]
            if b in labels:
                labels.setdefault(a, labels[b])
    return out


def _alike(seen: Seen, marks: IntArray, a: int, b: int, values: Values) -> bool:
    """Whether half of what was seen of one would pass for the other, and the other way round."""
    shares = []
    for mine, other in ((a, b), (b, a)):
        places = np.flatnonzero((marks == mine) & values.layout.contains(seen.observers))
        if not len(places):
            return False
        targets = np.full(len(places), FIRST + other)
        found = slopes(seen.rows(places, targets), values, len(places))
        shares.append(np.mean(np.sum(found.error**2, -1) <= gate(found.rank)))
    return bool(min(shares) >= 0.5)


def labels_of(seen: Seen, marks: IntArray) -> dict[int, int]:
    """The label of each landmark that has one: what most of its sightings say."""
    out = {}
    for mark in np.unique(marks[(marks >= 0) & (seen.labels >= 0)]).tolist():
        said, count = np.unique(seen.labels[(marks == mark) & (seen.labels >= 0)], return_counts=True)
        out[int(mark)] = int(said[np.argmax(count)])
    return out
