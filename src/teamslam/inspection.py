"""What a log holds, what is odd about it, and whether it can be solved, before anything is solved.

    counts   rows per robot, source and model, with the time they span
    gaps     where a robot's poses are far apart in time, and where its odometry breaks
    links    what connects each pair of robots: common landmarks, sightings of each other
    hints    in words: what cannot be placed, and what would cure it

A link holds a robot's frame where it fixes all its numbers: in the plane two common landmarks or one sighting of a
pose, in space three landmarks (not in line) or one pose. It is a count, not a proof: geometry may still be too weak,
which the join itself will say.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Dataset, Table, is_landmark, is_pose, robot_of

GAP_FACTOR = 20.0  # a gap is this many times the usual step
UNSEEN = 2  # landmarks seen by fewer rows than this hang on one sighting


@dataclass(frozen=True)
class Count:
    """Rows of one kind by one robot, and the stamps [s] of the first and last."""

    robot: int
    source: str
    model: str
    rows: int
    start_s: float
    stop_s: float


@dataclass(frozen=True)
class Link:
    """What connects two robots: landmarks that both saw, and rows in which one saw the other."""

    robots: tuple[int, int]
    landmarks: int
    sightings: int
    holds: bool


@dataclass(frozen=True)
class Inspection:
    """A log in figures and words; `groups` are the robots that links hold together."""

    robots: dict[int, int]
    poses: dict[int, int]
    landmarks: int
    counts: tuple[Count, ...]
    links: tuple[Link, ...]
    groups: tuple[tuple[int, ...], ...]
    has_truth: bool
    hints: tuple[str, ...]


def inspect(dataset: Dataset) -> Inspection:
    """Look a log over; nothing is changed and nothing solved."""
    links = tuple(_links(dataset))
    groups = _groups(sorted(dataset.robots), links)
    return Inspection(
        robots=dict(dataset.robots),
        poses={robot: len(keys) for robot, keys in dataset.pose_keys.items()},
        landmarks=len(dataset.landmark_keys),
        counts=tuple(_counts(dataset)),
        links=links,
        groups=groups,
        has_truth=dataset.truth is not None,
        hints=tuple(_hints(dataset, links, groups)),
    )


def _counts(dataset: Dataset) -> Iterator[Count]:
    for table in dataset.tables:
        stamps = dataset.names.stamps_s(_observers(table))
        span = (float(stamps.min()), float(stamps.max())) if len(stamps) else (np.nan, np.nan)
        yield Count(table.robot, table.source, table.model, len(table), *span)


def _observers(table: Table) -> IntArray:
    """The pose that each row was taken from; of a step between two own poses, the later."""
    own = (robot_of(table.keys) == table.robot) & is_pose(table.keys)
    return np.asarray(np.where(own, table.keys, 0).max(-1))


def _links(dataset: Dataset) -> Iterator[Link]:
    marks = {robot: _landmarks_of(dataset, robot) for robot in dataset.robots}
    robots = sorted(dataset.robots)
    for i, a in enumerate(robots):
        for b in robots[i + 1 :]:
            shared = np.intersect1d(marks[a], marks[b])
            between = [_of_each_other(table, a, b) for table in dataset.tables]
            sightings = sum(len(t) for t in between)
            held = sum(_numbers_held(t) for t in between)
            need, per_mark = (3, 2) if dataset.robots[a] == dataset.robots[b] == 2 else (6, 3)
            # The last mark of three in space adds two numbers, not three: a turn about the line of the others is one.
            held += per_mark * len(shared) - (per_mark == 3 and len(shared) > 0)
            oriented = any(t.row.targets_pose and np.isin(t.keys[:, -1], shared).any() for t in dataset.tables)
            if len(shared) or sightings:
                yield Link((a, b), len(shared), sightings, bool(held >= need or oriented))


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


def _groups(robots: list[int], links: tuple[Link, ...]) -> tuple[tuple[int, ...], ...]:
    home = {robot: robot for robot in robots}
    for link in links:
        if link.holds:
            a, b = sorted(home[r] for r in link.robots)
            home = {robot: a if root == b else root for robot, root in home.items()}
    return tuple(tuple(r for r in robots if home[r] == root) for root in sorted(set(home.values())))


# --- hints ----------------------------------------------------------------------------------------------------------


def _hints(dataset: Dataset, links: tuple[Link, ...], groups: tuple[tuple[int, ...], ...]) -> Iterator[str]:
    names = dataset.names
    for robot in sorted(dataset.robots):
        yield from _robot_hints(dataset, robot)
    lonely = _seen_once(dataset)
    if lonely:
        some = ", ".join(names.landmark(k) for k in lonely[:5]) + (", ..." if len(lonely) > 5 else "")
        yield f"{len(lonely)} landmarks were seen only once ({some}): nothing checks them"
    for group in groups[1:]:
        who = " and ".join(names.robot(r) for r in group)
        weak = [link for link in links if not link.holds and (set(link.robots) & set(group))]
        found = max((link.landmarks for link in weak), default=0)
        planar = all(dataset.robots[r] == 2 for r in group)
        need = "two common landmarks" if planar else "three common landmarks"
        share = f"only {found} common landmark" + "s" * (found != 1) if weak else "nothing in common"
        first = " and ".join(names.robot(r) for r in groups[0])
        yield (
            f"robot {who} cannot be joined to robot {first}: {share}; "
            f"{need}, or one sighting of a robot's pose, would join them"
        )
    if dataset.truth is None:
        yield "no truth: errors cannot be scored"


def _robot_hints(dataset: Dataset, robot: int) -> Iterator[str]:
    name, poses = dataset.names.robot(robot), dataset.pose_keys[robot]
    if not len(poses):
        yield f"robot {name} has no pose: none of its measurements can be placed"
        return
    stamps = dataset.names.stamps_s(poses)
    steps = np.diff(stamps)
    if len(steps) > 2 and (usual := float(np.median(steps))) > 0.0:
        gaps = np.flatnonzero(steps > GAP_FACTOR * usual)
        if len(gaps):
            worst = gaps[np.argmax(steps[gaps])]
            yield (
                f"robot {name}: {len(gaps)} gaps of more than {GAP_FACTOR * usual:.3g} s between poses, the longest "
                f"{steps[worst]:.3g} s, {stamps[worst] - stamps[0]:.1f} s after its start"
            )
    chained = _odometry_pairs(dataset, robot)
    broken = np.count_nonzero(~np.isin(poses[1:], chained)) if len(poses) > 1 else 0
    if broken:
        yield f"robot {name}: odometry is missing before {broken} of its {len(poses)} poses; the log is cut there"
    if not any(t.robot == robot and t.source != "odometry" and len(t) for t in dataset.tables):
        yield f"robot {name} saw nothing: its map is dead reckoning"


def _odometry_pairs(dataset: Dataset, robot: int) -> IntArray:
    """The later poses of all relative poses between the robot's own poses."""
    own = [t.keys.max(1)[(robot_of(t.keys) == robot).all(1)] for t in dataset.tables if t.model == "relative_pose"]
    return np.unique(np.concatenate(own)) if own else np.zeros(0, np.int64)


def _seen_once(dataset: Dataset) -> list[int]:
    seen = [t.keys[:, -1][is_landmark(t.keys[:, -1])] for t in dataset.tables]
    if not seen:
        return []
    keys, counts = np.unique(np.concatenate(seen), return_counts=True)
    return [int(k) for k in keys[counts < UNSEEN]]
