"""What a log holds, what is odd about it, and whether it can be solved, before anything is solved.

    counts   rows per robot, source and model, with the time they span
    gaps     where a robot's poses are far apart in time, and where its odometry breaks
    links    what connects each pair of robots: common landmarks, sightings of each other
    hints    in words: what cannot be placed, and what would cure it

A link holds a robot's frame where it fixes all its numbers: in the plane two common landmarks or one sighting of a
pose, in space three landmarks (not in line) or one pose. Robots that are held together count as one against others.
It is a count, not a proof: geometry may still be too weak, which the join itself will say.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Dataset, Names, Table, is_landmark, is_pose, is_unnamed, robot_of
from teamslam.oddities import oddities

GAP_FACTOR = 20.0  # a gap is this many times the usual step
UNSEEN = 2  # landmarks seen by fewer rows than this hang on one sighting


@dataclass(frozen=True)
class Count:
    """Rows of one kind by one robot (by the `sensor` of a name, where it has one), and the stamps [s] of the first and
    last."""

    robot: int
    source: str
    model: str
    rows: int
    start_s: float
    stop_s: float
    sensor: str = ""


@dataclass(frozen=True)
class Link:
    """What connects two robots: landmarks that both saw, and rows in which one saw the other."""

    robots: tuple[int, int]
    landmarks: int
    sightings: int
    holds: bool


@dataclass(frozen=True)
class Inspection:
    """A log in figures and words; `groups` are the robots that links hold together, or that sightings of landmarks
    without a name may. These are no `landmarks`."""

    robots: dict[int, int]
    poses: dict[int, int]
    landmarks: int
    counts: tuple[Count, ...]
    links: tuple[Link, ...]
    groups: tuple[tuple[int, ...], ...]
    has_truth: bool
    hints: tuple[str, ...]

    def to_dict(self, names: Names) -> dict[str, Any]:
        """Ready for JSON, robots by their names."""
        called = names.robot
        return {
            "robots": {called(robot): {"dim": dim, "poses": self.poses[robot]} for robot, dim in self.robots.items()},
            "landmarks": self.landmarks,
            "truth": self.has_truth,
            "measured": [vars(count) | {"robot": called(count.robot)} for count in self.counts],
            "links": [vars(link) | {"robots": [*map(called, link.robots)]} for link in self.links],
            "groups": [[*map(called, group)] for group in self.groups],
            "hints": list(self.hints),
        }


def inspect(dataset: Dataset) -> Inspection:
    """Look a log over; nothing is changed and nothing solved."""
    bonds = tuple(_bonds(dataset))
    links = tuple(bond.link for bond in bonds if len(bond.shared) or bond.sightings)
    groups = _groups(dataset, bonds)
    return Inspection(
        robots=dict(dataset.robots),
        poses={robot: len(keys) for robot, keys in dataset.pose_keys.items()},
        landmarks=int((~is_unnamed(dataset.landmark_keys)).sum()),
        counts=tuple(_counts(dataset)),
        links=links,
        groups=groups,
        has_truth=dataset.truth is not None,
        hints=tuple(_hints(dataset, links, groups)),
    )


def _counts(dataset: Dataset) -> Iterator[Count]:
    for table in dataset.tables:
        own = table.keys[is_pose(table.keys) & (robot_of(table.keys) == table.robot)]
        stamps = dataset.names.stamps_s(own)
        span = (float(stamps.min()), float(stamps.max())) if len(stamps) else (np.nan, np.nan)
        yield Count(table.robot, table.source, table.model, len(table), *span, table.called)


# --- what holds robots together -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Bond:
    """What two robots, or two groups of them, have in common: landmarks, and numbers that sightings of each other fix.
    `oriented`: one of the landmarks is seen as a pose."""

    robots: tuple[int, int]
    shared: IntArray
    sightings: int
    numbers: int
    planar: bool
    oriented: bool

    @property
    def holds(self) -> bool:
        """Whether it fixes one's frame in the other's."""
        per_mark = 2 if self.planar else 3
        # The last mark of three in space adds two numbers, not three: a turn about the line of the others is one.
        held = self.numbers + per_mark * len(self.shared) - (not self.planar and len(self.shared) > 0)
        return bool(held >= _need(self.planar) or self.oriented)

    @property
    def link(self) -> Link:
        return Link(self.robots, len(self.shared), self.sightings, self.holds)


def _need(planar: bool) -> int:
    """The numbers of a frame."""
    return 3 if planar else 6


def _bonds(dataset: Dataset) -> Iterator[_Bond]:
    """Every pair of robots."""
    marks = {robot: _landmarks_of(dataset, robot) for robot in dataset.robots}
    oriented = [t.keys[:, -1] for t in dataset.tables if t.row.targets_pose]
    turned = np.unique(np.concatenate(oriented)) if oriented else np.zeros(0, np.int64)
    for a, b in itertools.combinations(sorted(dataset.robots), 2):
        shared = np.intersect1d(marks[a], marks[b])
        between = [_of_each_other(table, a, b) for table in dataset.tables]
        yield _Bond(
            robots=(a, b),
            shared=shared,
            sightings=sum(len(t) for t in between),
            numbers=sum(_numbers_held(t) for t in between),
            planar=dataset.robots[a] == dataset.robots[b] == 2,
            oriented=bool(np.isin(turned, shared).any()),
        )


def _landmarks_of(dataset: Dataset, robot: int) -> IntArray:
    seen = [t.keys[:, -1] for t in dataset.tables if t.robot == robot and not t.row.unary]
    seen = [k[is_landmark(k)] for k in seen]
    return np.unique(np.concatenate(seen)) if seen else np.zeros(0, np.int64)


def _of_each_other(table: Table, a: int, b: int) -> Table:
    """The rows in which one of two robots saw the other."""
    if table.row.unary or table.robot not in (a, b):
        return table.select(np.zeros(len(table), bool))
    return table.select(robot_of(table.keys[:, -1]) == (b if table.robot == a else a))


def _numbers_held(table: Table) -> int:
    """How many numbers of the other's frame these rows may fix, told apart only by different poses."""
    return len(np.unique(table.keys[:, 0])) * table.row.residual_rows(table.dim) if len(table) else 0


def _groups(dataset: Dataset, bonds: Sequence[_Bond]) -> tuple[tuple[int, ...], ...]:
    """The robots that are held together: by a bond, by those of several robots together, or in a ring."""
    groups = [frozenset([robot]) for robot in dataset.robots]
    while (merged := _two_that_hold(groups, bonds)) or (merged := _ring(groups, bonds, dataset)):
        groups = [group for group in groups if not group <= merged] + [merged]
    if _nameless(dataset):
        groups = _that_names_may_join(groups, dataset)
    return tuple(sorted(tuple(sorted(group)) for group in groups))


def _nameless(dataset: Dataset) -> dict[int, int]:
    """How many sightings of landmarks without a name each robot made that made any."""
    counts = {robot: int(is_unnamed(_landmarks_of(dataset, robot)).sum()) for robot in sorted(dataset.robots)}
    return {robot: count for robot, count in counts.items() if count}


def _that_names_may_join(groups: Sequence[frozenset[int]], dataset: Dataset) -> list[frozenset[int]]:
    """Groups, of which those are one that sightings without a name may tie: all that saw landmarks."""
    saw = frozenset(robot for robot in dataset.robots if len(_landmarks_of(dataset, robot)))
    apart = [group for group in groups if not group & saw]
    tied = [group for group in groups if group & saw]
    return [*apart, frozenset().union(*tied)]


def _between(a: frozenset[int], b: frozenset[int], bonds: Sequence[_Bond]) -> _Bond:
    """What two groups have in common."""
    across = [bond for bond in bonds if len(a & {*bond.robots}) == len(b & {*bond.robots}) == 1]
    return _Bond(
        robots=(min(a), min(b)),
        shared=np.unique(np.concatenate([bond.shared for bond in across])),
        sightings=sum(bond.sightings for bond in across),
        numbers=sum(bond.numbers for bond in across),
        planar=all(bond.planar for bond in across),
        oriented=any(bond.oriented for bond in across),
    )


def _two_that_hold(groups: Sequence[frozenset[int]], bonds: Sequence[_Bond]) -> frozenset[int] | None:
    for a, b in itertools.combinations(groups, 2):
        if _between(a, b, bonds).holds:
            return a | b
    return None


def _ring(groups: Sequence[frozenset[int]], bonds: Sequence[_Bond], dataset: Dataset) -> frozenset[int] | None:
    """Groups that have enough in common all together, though no two of them have (three robots, each pair with one
    landmark): those that have least are left out until the rest has enough."""
    left = list(groups)
    while len(left) > 2:
        pairs = [(a, b, _between(a, b, bonds)) for a, b in itertools.combinations(left, 2)]
        planar = all(bond.planar for _, _, bond in pairs)
        marks = np.concatenate(
            [np.unique(np.concatenate([_landmarks_of(dataset, r) for r in group])) for group in left]
        )
        _, known_by = np.unique(marks, return_counts=True)
        held = (2 if planar else 3) * int((known_by - 1).sum()) + sum(bond.numbers for _, _, bond in pairs)
        if held >= _need(planar) * (len(left) - 1):
            return frozenset().union(*left)
        weight = {g: sum(len(k.shared) + k.numbers for a, b, k in pairs if g in (a, b)) for g in left}
        left.remove(min(left, key=lambda group: weight[group]))
    return None


# --- hints ----------------------------------------------------------------------------------------------------------


def _hints(dataset: Dataset, links: tuple[Link, ...], groups: tuple[tuple[int, ...], ...]) -> Iterator[str]:
    names = dataset.names
    for robot in sorted(dataset.robots):
        yield from _robot_hints(dataset, robot)
    yield from oddities(dataset)
    nameless = _nameless(dataset)
    if nameless:
        count = sum(nameless.values())
        who, these = names.these(list(nameless)), "sighting is" if count == 1 else "sightings are"
        yield (
            f"{who}: {count} {these} of landmarks without a name; `teamslam run` finds out which they are of, and "
            f"whether they tie robots together"
        )
    lonely = seen_once(dataset)
    if lonely:
        some = ", ".join(names.landmark(k) for k in lonely[:5]) + (", ..." if len(lonely) > 5 else "")
        were = "landmark was" if len(lonely) == 1 else "landmarks were"
        yield f"{len(lonely)} {were} seen only once ({some}): nothing checks {'it' if len(lonely) == 1 else 'them'}"
    for group in groups[1:]:
        yield _apart(dataset, groups, group, links)
    if dataset.truth is None:
        yield "no truth: errors cannot be scored"


def _apart(dataset: Dataset, groups: Sequence[tuple[int, ...]], group: tuple[int, ...], links: Sequence[Link]) -> str:
    """Why a group looks as if it could not be joined to the others, and what would join it."""
    across = [link for link in links if len({*link.robots} & {*group}) == 1]
    most = max((link.landmarks for link in across), default=0)
    seen = sum(link.sightings for link in across)
    shared = [f"at most {most} common landmark{'s' * (most != 1)} with any robot"] if most else []
    shared += [f"{seen} sighting{'s' * (seen != 1)} of each other"] if seen else []
    planar = all(dataset.robots[robot] == 2 for robot in dataset.robots)
    need = "two common landmarks" if planar else "three common landmarks"
    who, first = map(dataset.names.these, (group, groups[0]))
    return (
        f"{who} cannot be joined to {first}: {' and '.join(shared) or 'nothing in common'}; "
        f"{need}, or one sighting of a robot's pose, would join them"
    )


def _robot_hints(dataset: Dataset, robot: int) -> Iterator[str]:
    name, poses = dataset.names.robot(robot), dataset.pose_keys[robot]
    if not len(poses):
        yield f"robot {name} has no pose: nothing was measured from it"
        return
    stamps = dataset.names.stamps_s(poses)
    steps = np.diff(stamps)
    if len(steps) > 2 and (usual := float(np.median(steps))) > 0.0:
        gaps = np.flatnonzero(steps > GAP_FACTOR * usual)
        if len(gaps):
            worst = gaps[np.argmax(steps[gaps])]
            unit = "counts" if dataset.names.counts else "s"
            yield (
                f"robot {name}: {len(gaps)} gap{'s' * (len(gaps) != 1)} of more than {GAP_FACTOR * usual:.3g} {unit} "
                f"between poses, the longest {steps[worst]:.3g} {unit}, {stamps[worst] - stamps[0]:.1f} {unit} after "
                f"its start"
            )
    chained = _odometry_pairs(dataset, robot)
    broken = np.count_nonzero(~np.isin(poses[1:], chained)) if len(poses) > 1 else 0
    if broken:
        yield f"robot {name}: odometry is missing before {broken} of its {len(poses)} poses; the log is cut there"
    if not any(t.robot == robot and t.source != "odometry" and len(t) for t in dataset.tables):
        seen = any(t.robot != robot and (robot_of(t.keys) == robot).any() for t in dataset.tables)
        if seen:
            yield f"robot {name} saw nothing: only where others saw it is its dead reckoning put right"
        else:
            yield f"robot {name} saw nothing: its map is dead reckoning"


def _odometry_pairs(dataset: Dataset, robot: int) -> IntArray:
    """The later poses of all relative poses between the robot's own poses."""
    own = [t.keys.max(1)[(robot_of(t.keys) == robot).all(1)] for t in dataset.tables if t.model == "relative_pose"]
    return np.unique(np.concatenate(own)) if own else np.zeros(0, np.int64)


def seen_once(dataset: Dataset) -> list[int]:
    """The landmarks of a log that one row alone speaks of: nothing checks where they are. Of sightings without a name
    nobody knows yet which are of one."""
    seen = [t.keys[:, -1][is_landmark(t.keys[:, -1])] for t in dataset.tables]
    if not seen:
        return []
    keys, counts = np.unique(np.concatenate(seen), return_counts=True)
    return [int(k) for k in keys[(counts < UNSEEN) & ~is_unnamed(keys)]]
