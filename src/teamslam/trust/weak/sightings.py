"""Which sighting would firm up a map most: who should look at what, from where.

A sighting with the whitened Jacobian A adds A'A to the information. By the lemma of Woodbury, from the factor at hand,

    gain = 1/2 log det(1 + A P A')                          [nats] of all that is unknown
    sigma'^2 = f'P f - f'P A' (1 + A P A')^-1 A P f         of a weak direction f

for every candidate at once, from the covariance of the poses and landmarks that take part. What hangs loose altogether
(N) is tied by as many ways as A N has rank, and that comes first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.model import Names, Table, index_of, is_landmark, is_pose, robot_of
from teamslam.solver import linearise_numerically
from teamslam.trust.weak.eyes import Eye
from teamslam.trust.weak.knowledge import Knowledge
from teamslam.trust.weak.weakest import Weak
from teamslam.trust.weak.words import place

MOST = 5
VIEWPOINTS = 60  # poses of a robot that are tried, evenly along its way, its last one among them
CHUNK = 64  # columns of the covariance at a time
TIES = 1e-6


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
    found: dict[tuple[int, int], Sighting] = {}
    for eye, table in _candidates(weak.known, eyes):
        for sighting in _weighed(weak, eye, table):
            about = (int(robot_of(sighting.observer)), _thing(sighting.target))
            if about not in found or _rank(sighting) < _rank(found[about]):
                found[about] = sighting
    return tuple(sorted(filter(_helps, found.values()), key=_rank)[:most])


def _helps(sighting: Sighting) -> bool:
    """Whether it is worth a word: it ties something, or firms up a weak direction by a hundredth or more."""
    return bool(sighting.ties or not len(sighting.before) or sighting.firms > 0.01)


def _rank(sighting: Sighting) -> tuple[float, ...]:
    return (-sighting.ties, -round(sighting.firms, 9), -round(sighting.gain, 9), sighting.observer, sighting.target)


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


def _weighed(weak: Weak, eye: Eye, table: Table) -> list[Sighting]:
    known = weak.known
    layout = known.values.layout
    ends = np.unique(table.keys)
    unknowns = layout.unknowns(ends)
    place_of = np.full(layout.dof, -1)
    place_of[unknowns] = np.arange(len(unknowns))
    covariance = joint(known, unknowns)
    functions = [direction.hinge.function for direction in weak.directions]
    F = np.stack(functions, 1) if functions else np.zeros((layout.dof, 0))
    spread = known.spread(F)
    before = np.sqrt(np.sum(F * spread, 0))
    out = []
    for group in linearise_numerically(table, known.values):
        columns = np.stack([layout.unknowns(table.keys[row]) for row in group.rows])
        A, at = group.jacobian, place_of[columns]
        S = np.eye(A.shape[1]) + A @ covariance[at[:, :, None], at[:, None, :]] @ np.swapaxes(A, 1, 2)
        b = A @ spread[columns]
        gone = np.sum(b * np.linalg.solve(S, b), 1)
        after = np.sqrt(np.maximum(before**2 - gone, 0.0))
        gain = 0.5 * np.linalg.slogdet(S)[1]
        loose = A @ known.unknown[columns] * (1.0 / max(1.0, float(np.abs(A).max(initial=0.0))))
        ties = np.linalg.matrix_rank(loose, tol=TIES) if loose.shape[-1] else np.zeros(len(A), int)
        for k, row in enumerate(group.rows.tolist()):
            one = table.select(np.array([row]))
            observer, target = (int(key) for key in one.keys[0])
            dim = known.motions.dim
            apart = known.values.positions(np.array([observer, target]), dim)
            distance = float(np.linalg.norm(apart[1] - apart[0]))
            told = _sentence(weak, observer, target, distance, int(ties[k]), float(gain[k]), before, after[k])
            made = Eye(one, eye.sees_robots, eye.reach, eye.cosine)
            out.append(Sighting(observer, target, made, distance, float(gain[k]), int(ties[k]), before, after[k], told))
    return out


def joint(known: Knowledge, unknowns: IntArray) -> Array:
    """The covariance of some unknowns (c, c), by and by."""
    out = np.empty((len(unknowns), len(unknowns)))
    for start in range(0, len(unknowns), CHUNK):
        chosen = unknowns[start : start + CHUNK]
        unit = np.zeros((known.values.layout.dof, len(chosen)))
        unit[chosen, np.arange(len(chosen))] = 1.0
        out[:, start : start + CHUNK] = known.spread(unit)[unknowns]
    return out


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
