"""Which sighting would firm up a map most: who should look at what, from where.

    could    every sensor from its robot's poses, at all that it could see from there
    hope     what each of these would bring at most, for all of them at once (`gains`)
    weigh    exactly what the most hopeful bring, a few at a time, until no other can be better

What hangs loose altogether is to be tied first, by as many ways as there are; then the weak directions count.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Names, Table, index_of, is_landmark, is_pose, robot_of
from teamslam.trust.weak.eyes import Eye
from teamslam.trust.weak.gains import Directions, Hopes, Pairs, exactly, hopes_of
from teamslam.trust.weak.knowledge import Knowledge
from teamslam.trust.weak.weakest import Weak
from teamslam.trust.weak.words import place

MOST = 5
VIEWPOINTS = 60  # poses of a robot that are tried, evenly along its way, its last one among them
FEW = 16  # sightings that are weighed at a time
SLACK = 1e-6  # of what is promised, by rounding
WORTH = 1.05  # times as firm as before, some weak direction, for a sighting to be told


@dataclass(frozen=True, eq=False)
class Sighting:
    """A sighting that could be made: by the pose `observer` of `target` with a sensor like `eye`; `distance` [m].

    `gain` [nats]; `ties`: freedoms of what hangs loose that it takes away (the gain is then of the rest). `before` and
    `after` (k,): the sigma of each weak direction, in their order.
    """

    observer: int
    target: int
    eye: Eye
    distance: float
    gain: float
    ties: int
    before: Array
    after: Array
    sentence: str

    def __repr__(self) -> str:
        return f"Sighting({self.sentence})"

    @property
    def table(self) -> Table:
        """The sighting as a row, without noise: the model's own prediction."""
        return self.eye.like

    @property
    def firms(self) -> float:
        """By how much it firms up the weak directions: the sum of log(before / after)."""
        return float(np.sum(np.log(self.before / self.after)))


def look_next(weak: Weak, eyes: Sequence[Eye], most: int = MOST) -> tuple[Sighting, ...]:
    """The sightings that would firm up the weak directions of a map most, the best first.

    What is tried: every sensor from its robot's poses (`VIEWPOINTS` of them), at every landmark, and at robots that
    were there at the same time or stand at their ends, as far and as wide as it has seen. Of each robot and what it
    looks at, the best viewpoint is told. Where nothing is weak, the gain decides.
    """
    known, directions = weak.known, Directions.of(weak)
    hopes = [hope for eye, table in _candidates(known, eyes) for hope in hopes_of(known, directions, eye, table)]
    waiting = _the_most_hopeful_first(hopes)
    few = FEW if weak.directions else len(waiting)  # where the gain decides, nothing is promised of it
    pairs = Pairs(known, np.unique(np.concatenate([np.zeros(0, np.int64), *(hope.columns.ravel() for hope in hopes)])))
    found: dict[tuple[int, int], _Weighed] = {}
    while len(waiting):
        first, waiting = waiting[:few], waiting[few:]
        for one in _weighed(pairs, directions, hopes, first):
            about = _about(one.observer, one.target)
            if about not in found or one.rank < found[about].rank:
                found[about] = one
        best = sorted(one.rank for one in found.values())[:most]
        if len(best) == most:
            waiting = _that_may_be_better(waiting, best[-1])
    best_of_all = sorted(found.values(), key=lambda one: one.rank)
    told = (_told(weak, one) for one in best_of_all if one.helps)
    return tuple(islice(told, most))


@dataclass(frozen=True, eq=False)
class _Weighed:
    """What a hope's row would bring, exactly: `gain` [nats], and what it leaves of the weak directions (k,)."""

    hope: Hopes
    row: int
    gain: float
    before: Array
    after: Array

    @property
    def observer(self) -> int:
        return int(self.hope.table.keys[self.hope.rows[self.row], 0])

    @property
    def target(self) -> int:
        return int(self.hope.table.keys[self.hope.rows[self.row], 1])

    @property
    def ties(self) -> int:
        return int(self.hope.ties[self.row])

    @property
    def firms(self) -> float:
        return float(np.sum(np.log(self.before / self.after)))

    @cached_property
    def rank(self) -> tuple[float, ...]:
        return (-self.ties, -round(self.firms, 9), -round(self.gain, 9), self.observer, self.target)

    @property
    def helps(self) -> bool:
        """Whether it is worth a word: it ties something, or firms up a weak direction by a twentieth or more."""
        return bool(self.ties or not len(self.before) or (self.before / self.after).max() > WORTH)


def _the_most_hopeful_first(hopes: Sequence[Hopes]) -> Array:
    """What could be made: (m, 4) of the rank that each may have at best (two numbers, as in `_Weighed.rank`), which of
    the hopes, and which row of it."""
    rows = [
        np.stack([-hope.ties, -hope.firms, np.full(len(hope.rows), n), np.arange(len(hope.rows))], 1)
        for n, hope in enumerate(hopes)
    ]
    every = np.concatenate([np.zeros((0, 4)), *rows])
    return np.asarray(every[np.lexsort((every[:, 1], every[:, 0]))])


def _that_may_be_better(waiting: Array, worst: tuple[float, ...]) -> Array:
    """What may yet rank before the worst that would be told."""
    ties, firms = waiting[:, 0], waiting[:, 1] - SLACK
    return np.asarray(waiting[(ties < worst[0]) | ((ties == worst[0]) & (firms <= worst[1]))])


def _about(observer: int, target: int) -> tuple[int, int]:
    return int(robot_of(observer)), _thing(target)


def _thing(key: int) -> int:
    return key if is_landmark(key) else -int(robot_of(key))


# --- what could be seen -----------------------------------------------------------------------------------------------


def _candidates(known: Knowledge, eyes: Sequence[Eye]) -> list[tuple[Eye, Table]]:
    keys = known.values.layout.keys
    ways = {int(r): np.sort(keys[is_pose(keys) & (robot_of(keys) == r)]) for r in np.unique(robot_of(keys)) if r > 0}
    marks = np.sort(keys[is_landmark(keys)])
    out = []
    for eye in eyes:
        views = _spread_out(ways[eye.robot])
        pairs = _meetings(ways, eye.robot) if eye.sees_robots else _all_pairs(views, marks)
        table = eye.sightings(pairs, known.values)
        if len(table):
            out.append((eye, table))
    return out


def _spread_out(way: IntArray) -> IntArray:
    places = np.unique(np.linspace(0, len(way) - 1, min(len(way), VIEWPOINTS)).round().astype(int))
    return np.asarray(way[places])


def _all_pairs(views: IntArray, targets: IntArray) -> IntArray:
    return np.stack([np.repeat(views, len(targets)), np.tile(targets, len(views))], -1)


def _meetings(ways: dict[int, IntArray], robot: int) -> IntArray:
    """Poses of a robot and of others at the same time, some of them, and where each ends."""
    mine, pairs = ways[robot], [np.zeros((0, 2), np.int64)]
    for other, theirs in ways.items():
        if other == robot:
            continue
        _, here, there = np.intersect1d(index_of(mine), index_of(theirs), return_indices=True)
        together = np.stack([mine[here], theirs[there]], -1)
        pairs.append(together[_evenly(len(together))])
        pairs.append(np.array([[mine[-1], theirs[-1]]]))
    return np.unique(np.concatenate(pairs), axis=0)


def _evenly(count: int) -> IntArray:
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, VIEWPOINTS)).round().astype(np.int64))[:count]


# --- what it would bring ----------------------------------------------------------------------------------------------


def _weighed(pairs: Pairs, directions: Directions, hopes: Sequence[Hopes], some: Array) -> Iterator[_Weighed]:
    """What some of the hopes bring, exactly."""
    before = np.sqrt(directions.variances)
    which, rows = some[:, 2].astype(int), some[:, 3].astype(int)
    for number in np.unique(which).tolist():
        hope, mine = hopes[number], rows[which == number]
        keys = hope.table.keys[hope.rows[mine]]
        gains, left = exactly(pairs, directions, hope.A[mine], keys, hope.columns[mine])
        for row, gain, after in zip(mine.tolist(), gains.tolist(), left, strict=True):
            yield _Weighed(hope, row, gain, before, after)


def _told(weak: Weak, one: _Weighed) -> Sighting:
    known, row = weak.known, one.hope.table.select(one.hope.rows[one.row : one.row + 1])
    apart = known.values.positions(row.keys[0], known.motions.dim)
    distance = float(np.linalg.norm(apart[1] - apart[0]))
    said = _sentence(weak, one.observer, one.target, distance, one.ties, one.gain, one.before, one.after)
    made = Eye(row, one.hope.eye.sees_robots, one.hope.eye.reach, one.hope.eye.cosine)
    return Sighting(one.observer, one.target, made, distance, one.gain, one.ties, one.before, one.after, said)


def _sentence(
    weak: Weak, observer: int, target: int, distance: float, ties: int, gain: float, before: Array, after: Array
) -> str:
    """'Robot 2, from where it ends, at landmark 7 (4.2 m away): 0.21 -> 0.05 rad'."""
    names = weak.known.names
    who = f"robot {names.robot(int(robot_of(observer)))}, {_from(weak.known, observer, names)}"
    text = f"{who}, at {names.describe(target)} ({distance:.1f} m away): "
    if ties:
        text += f"would tie {ties} of {weak.known.unknown.shape[1]} ways in which parts hang loose"
    elif len(before):
        best = int(np.argmax(before / after))
        text += f"{before[best]:.2g} -> {after[best]:.2g} {weak.directions[best].unit} of direction {best + 1}"
    else:
        text += f"{gain:.2g} nats"
    return text[:1].upper() + text[1:]


def _from(known: Knowledge, observer: int, names: Names) -> str:
    keys = known.values.layout.keys
    way = keys[is_pose(keys) & (robot_of(keys) == robot_of(observer))]
    if observer == way.max():
        return "from where it ends"
    at = known.values.positions(np.array([observer]), known.motions.dim)[0]
    return f"from {place(at)}, where it was at {names.describe(observer).rpartition(' at ')[2]}"
