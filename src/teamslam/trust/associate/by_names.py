"""Who is who where most sightings name their landmark: the few that do not are told by the map of those that do.

    map     what has a name is joined, as if the rest were not there
    tell    each image that shows something without a name is judged by joint compatibility with the landmarks nearest
            to where its sightings put theirs, but for those that the image names; where sightings with names are worse
            than stated, all errors are taken to be
    again   with what was told, as long as anything is left open that this may decide
    rest    what is of none of them has landmarks of its own, told apart along the ways that this map knows (`cooling`)

Landmarks that nobody named but which were told apart serve as names do for what was left open (`told_again`).

The cost is that of a map of the log, and of one solve for each landmark that stands near a sighting without a name.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import IntArray
from teamslam.joining import build, join, split
from teamslam.joining.start.targets import place_targets
from teamslam.model import Dataset, Submap, chi2_quantile, is_landmark, is_unnamed
from teamslam.trust.associate.compatible import NONE, UNSURE, matched
from teamslam.trust.associate.cooling import FIRST, cooled_beside
from teamslam.trust.associate.filter import Innovations
from teamslam.trust.associate.joint import Joint
from teamslam.trust.associate.mixture import FEWEST
from teamslam.trust.associate.sensing import Seen, slopes
from teamslam.trust.associate.within import relabelled

ROUNDS = 3
NEAR = 10  # landmarks that a sighting may be of
MANY = 0.1  # of sightings, that are of no landmark with a name
BEYOND = 1 << 60  # numbers that are no key of a landmark
Tell = Callable[[int, int], None]


def by_names(log: Dataset, tell: Tell) -> dict[int, IntArray] | None:
    """By robot, the landmark (m,) of each of its sightings that place one (`Seen.of`): the key of one that has a name,
    or a number beyond all keys for one that has none; NONE where it is of none, UNSURE where of several. None where
    names do not tell: a robot has more sightings without than with one, or no map comes of these.

    `tell` hears how far this is, and of how much. Law: sightings of one image are of different landmarks.
    """
    seen = {robot: Seen.of(log.of_robot(robot), robot) for robot in log.robots}
    if any((each.labels < 0).sum() > _named(log, robot) for robot, each in seen.items()):
        return None
    marks = {robot: each.labels for robot, each in seen.items()}  # a label is a key, and NONE where there is none
    for at in range(ROUNDS):
        tell(at, ROUNDS)
        maps = _maps(_told(log, seen, marks))
        if not maps:
            return None
        before, marks = marks, {robot: _judged(log, each, marks[robot], maps) for robot, each in seen.items()}
        if all((found != UNSURE).all() or np.array_equal(found, before[robot]) for robot, found in marks.items()):
            break
    return _with_rest(log, seen, marks)


def told_again(log: Dataset, marks: Mapping[int, IntArray]) -> dict[int, IntArray]:
    """By robot, the landmark (m,) of each of its sightings, by a number in the team, where some were left open (below
    0): these are judged, once, by the map of those that are told, as if that were their names."""
    seen = {robot: Seen.of(log.of_robot(robot), robot) for robot in log.robots}
    keys = {robot: np.where(found >= 0, found + FIRST, found) for robot, found in marks.items()}
    maps = _maps(_told(log, seen, keys))
    named = {robot: replace(each, labels=np.maximum(keys[robot], NONE)) for robot, each in seen.items()}
    found = {robot: _judged(log, each, keys[robot], maps) for robot, each in named.items()}
    return {robot: np.where(keys >= 0, keys - FIRST, keys) for robot, keys in found.items()}


def _named(log: Dataset, robot: int) -> int:
    """How many of a robot's sightings have a name, whether they place something or not."""
    targets = [table.keys[:, -1] for table in log.tables if table.robot == robot]
    return sum(int((is_landmark(target) & ~is_unnamed(target)).sum()) for target in targets)


def _told(log: Dataset, seen: Mapping[int, Seen], keys: Mapping[int, IntArray]) -> Dataset:
    """The log in which every sighting is of the landmark with this key; those with a key below 0 are left out,
    and what has no name and places nothing."""
    tables = []
    for robot, each in seen.items():
        for table in relabelled(log.of_robot(robot), each, keys[robot]).tables:
            target = table.keys[:, -1]
            tables.append(table.select(np.flatnonzero(~is_unnamed(target) | np.isin(target, keys[robot]))))
    return log.with_tables(table for table in tables if len(table))


def _maps(log: Dataset) -> list[Submap]:
    """The maps of a log, one for each of its parts; none where nothing can be built."""
    submaps = []
    for piece in split(log):
        try:
            submaps.append(build(piece))
        except SolveError:
            continue
    try:
        return [component.map for component in join(submaps).components] if submaps else []
    except SolveError:
        return []


# --- tell -------------------------------------------------------------------------------------------------------------


def _judged(log: Dataset, seen: Seen, marks: IntArray, maps: Sequence[Submap]) -> IntArray:
    """The landmark of each of a robot's sightings (m,), those without a name judged by the maps."""
    out = marks.copy()
    if not (seen.labels < 0).any():
        return out
    kinds = log.layout.kinds[log.layout.index(seen.targets)]
    for map in maps:
        values = map.all_values
        here = (seen.labels < 0) & values.layout.contains(seen.observers)
        known = map.landmark_keys
        of_kind = values.layout.kinds[values.layout.index(known)]
        for kind in np.unique(kinds[here]).tolist():
            if (of_kind == kind).any():
                places = np.flatnonzero(here & (kinds == kind))
                out[places] = _of_which(log, seen, places, map, known[of_kind == kind])
    return out


def _of_which(log: Dataset, seen: Seen, places: IntArray, map: Submap, known: IntArray) -> IntArray:
    """The landmark, of those that are `known` in a map, of each of some sightings without a name (k,)."""
    values, scale = map.all_values, _scale(seen, map, known)
    bare = seen.select(places).blurred(scale)
    near = _nearest(log, bare, map, known)
    among = np.unique(near)
    joint = Joint(map, known[among], bare.observers)
    often = np.array([np.count_nonzero(seen.labels == key) for key in known[among].tolist()])
    out = np.full(len(bare), NONE)
    for image in _images(bare.observers):
        pose = int(bare.observers[image[0]])
        named = seen.labels[seen.observers == pose]
        may = np.flatnonzero(np.isin(among, near[image]) & ~np.isin(known[among], named))
        if not len(may):
            continue
        which, targets = np.repeat(np.arange(len(image)), len(may)), np.tile(np.arange(len(may)), len(image))
        found = slopes(bare.rows(image[which], known[among[may]][targets]), values, len(which))
        covariance = scale**2 * joint.with_pose(pose, found.of_pose.shape[2], may)
        pairs = Innovations(found, targets, covariance, -2.0 * np.log(np.maximum(often[may], 1)[targets]))
        best = matched(pairs, which, np.ones(len(which), bool))
        out[image] = np.where(best >= 0, known[among[may]][targets[np.maximum(best, 0)]], best)
    return out


def _images(observers: IntArray) -> list[IntArray]:
    """Which sightings were taken together."""
    order = np.argsort(observers, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(observers[order])) + 1)


def _nearest(log: Dataset, bare: Seen, map: Submap, known: IntArray) -> IntArray:
    """The landmarks (k, NEAR), by their place in `known`, that are nearest to where sightings put theirs."""
    from scipy.spatial import cKDTree

    dim = 2 + int((map.values.layout.kinds[map.values.layout.index(known)] % 2).max())
    there = place_targets(map.all_values, bare.tables, log.layout).positions(bare.targets, dim)
    near = cKDTree(map.values.positions(known, dim)).query(there, min(NEAR, len(known)))[1]
    return np.asarray(near).reshape(len(bare), -1)


def _scale(seen: Seen, map: Submap, known: IntArray) -> float:
    """How many times larger than stated the errors of sightings with names look in a map; 1 where they look smaller."""
    values = map.all_values
    named = np.flatnonzero(np.isin(seen.labels, known) & values.layout.contains(seen.observers))
    if not len(named):
        return 1.0
    found = slopes(seen.rows(named, seen.labels[named]), values, len(named))
    ratio = np.sum(found.error**2, -1) / chi2_quantile(0.5, found.rank)
    return float(np.sqrt(max(np.median(ratio), 1.0)))


# --- rest -------------------------------------------------------------------------------------------------------------


def _with_rest(log: Dataset, seen: Mapping[int, Seen], marks: dict[int, IntArray]) -> dict[int, IntArray] | None:
    """With landmarks of their own for sightings that are of none that has a name; None where there are many such that
    nobody can tell apart along the ways that the names know."""
    none = {robot: found == NONE for robot, found in marks.items()}
    count = sum(int(rest.sum()) for rest in none.values())
    if count < FEWEST:
        return marks
    keys = {robot: np.where(none[robot], seen[robot].targets, found) for robot, found in marks.items()}
    told = cooled_beside(_told(log, seen, keys))
    if told is None:
        return None if count > MANY * sum(map(len, seen.values())) else marks
    out = {robot: found.copy() for robot, found in marks.items()}
    for robot, found in told.marks.items():
        out[robot][none[robot]] = np.where(found >= 0, found + BEYOND, found)
    return out
