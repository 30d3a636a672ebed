"""On which side of a line robots are that ranges alone tie to the rest.

A range knows no left and right. A robot in the plane of which nothing but its odometry and ranges is known fits on
either side of the line on which lies what it ranges, such as anchors along a wall; a team of such robots fits in a
mirror. Straight ways make both as good. So the map is reflected,

    p' = c + S (p - c) ,  h' = 2 a - h ,     S the reflection about a line through c in the direction a,

one robot after another, with what nobody else sees, and the whole; it is solved again from there. Of robots the lowest
counts; the whole stays, as nothing tells. What costs no more than RULED_OUT more is named.

Bound: nothing where no robot is tied by ranges alone; else a search of few steps for each such robot and for the whole,
once more after each that leads lower.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.start.twofold import RULED_OUT
from teamslam.model import Kind, Names, Table, Values, is_landmark, is_pose, robot_of
from teamslam.solver import Options, Solution, System, firm, optimise

FLAT = 0.2  # of its length: how wide a line may be
LOWER = 1e-3  # of cost, that a map is lower
FAR = 9.0  # squared sigmas that another map is away
STEPS = Options(max_iterations=30, decrement=0.01, elsewhere=False)
MOST = 12  # robots that are reflected


@dataclass(frozen=True, eq=False)
class Mirrored:
    """That a robot (0: the whole map) fits in a mirror as well, for so much `more` of cost."""

    robot: int
    more: float

    def sentence(self, names: Names) -> str:
        """In words."""
        costs = f"for {self.more:.2g} more of cost" if self.more > 0.0 else "for no more of cost"
        if not self.robot:
            return (
                f"ambiguous: the whole map fits in a mirror too, {costs}; a bearing, or places in the world, would tell"
            )
        return (
            f"ambiguous: robot {names.robot(self.robot)} fits on the other side of what it ranges too, {costs}; a "
            f"bearing, or ranges to what lies off that line, would tell"
        )


def sides(values: Values, tables: Sequence[Table], fixed: IntArray) -> tuple[Values | None, list[Mirrored]]:
    """A map with robots on the side on which it costs least, None where that is where they are; and what fits on the
    other side, too."""
    ranged = _ranged(values, tables)
    whole = bool(len(fixed)) and set(ranged) == set(np.unique(robot_of(_poses(values))).tolist())
    if not ranged or len(ranged) > MOST:
        return None, []
    try:
        at = _solved(values, tables, fixed)
        best, start = (at.cost, at.values), at.cost
        for _ in range(len(ranged) + 1):
            found = list(_reflected(best[1], tables, fixed, ranged, whole=whole))
            lower = min((one for one in found if one[0]), key=lambda one: one[1], default=None)
            if lower is None or lower[1] > best[0] - LOWER:
                break
            best = lower[1], lower[2]
        near = [Mirrored(robot, cost - best[0]) for robot, cost, there in found if cost < best[0] + RULED_OUT]
    except TeamslamError:
        return None, []
    return (best[1] if best[0] < start - LOWER else None), near


def _ranged(values: Values, tables: Sequence[Table]) -> list[int]:
    """The robots in the plane of which all that is known but their odometry is ranges."""
    poses = _poses(values)
    seen = [t for t in tables if not (t.is_odometry and t.own.all())]
    told = np.concatenate([np.zeros(0, np.int64), *(robot_of(t.keys.ravel()) for t in seen if t.model != "range")])
    tied = np.concatenate([np.zeros(0, np.int64), *(robot_of(t.keys.ravel()) for t in seen if t.model == "range")])
    flat = (values.layout.kinds % 2 == 0).all()
    return [r for r in np.unique(robot_of(poses)).tolist() if flat and r in tied and r not in told]


def _poses(values: Values) -> IntArray:
    return values.layout.keys[is_pose(values.layout.keys)]


def _reflected(
    values: Values, tables: Sequence[Table], fixed: IntArray, ranged: Sequence[int], *, whole: bool
) -> Iterator[tuple[int, float, Values]]:
    """The optima from where each robot, and the whole, is reflected; without those that are where it was."""
    keys = values.layout.keys
    for robot in ranged:
        own, line = _own(tables, robot), _line(values, tables, robot)
        if line is None or len(own) == len(keys):
            continue
        moved = keys[np.isin(keys, own)] if not np.isin(fixed, own).any() else keys[~np.isin(keys, own)]
        yield from _elsewhere(robot, values, _mirrored(values, moved, *line), tables, fixed)
    if whole:
        base = values.poses_of(fixed, 2).xytheta()[0]
        yield from _elsewhere(0, values, _mirrored(values, keys, base[:2], float(base[2])), tables, fixed)


def _elsewhere(
    robot: int, values: Values, start: Values, tables: Sequence[Table], fixed: IntArray
) -> Iterator[tuple[int, float, Values]]:
    try:
        found = _solved(start, tables, fixed)
    except TeamslamError:
        return
    free = np.setdiff1d(values.layout.keys, fixed)
    off = found.values.only(free).minus(values.only(free))
    if float(off @ (found.information @ off)) > FAR:
        yield robot, found.cost, found.values


def _solved(start: Values, tables: Sequence[Table], fixed: IntArray) -> Solution:
    system = System(start.layout, tables=tables, fixed=fixed)
    return firm(system, optimise(system, start, STEPS))


def _own(tables: Sequence[Table], robot: int) -> IntArray:
    """A robot's poses, and the landmarks that it alone ranges."""
    mine = [t.keys.ravel() for t in tables if (robot_of(t.keys) == robot).any()]
    others = [t.keys[(robot_of(t.keys) != robot) | is_landmark(t.keys)] for t in tables if t.robot != robot]
    return np.setdiff1d(np.unique(np.concatenate(mine)), np.concatenate([np.zeros(0, np.int64), *others]))


def _line(values: Values, tables: Sequence[Table], robot: int) -> tuple[Array, float] | None:
    """The line on which all lies that a robot ranges and others know: a point of it and its direction; None where that
    lies on none."""
    own = _own(tables, robot)
    keys = [t.keys.ravel() for t in tables if t.model == "range" and (robot_of(t.keys) == robot).any()]
    shared = np.setdiff1d(np.unique(np.concatenate(keys)), own)
    shared = shared[np.asarray(values.layout.contains(shared)) & ~(is_pose(shared) & (robot_of(shared) == robot))]
    if not len(shared):
        return None
    places = values.positions(shared, 2)
    middle = places.mean(0)
    _, spread, axes = np.linalg.svd(places - middle, full_matrices=False)
    if len(shared) > 1 and spread[-1] > FLAT * spread[0]:
        return None
    return middle, float(np.arctan2(axes[0, 1], axes[0, 0]))


def _mirrored(values: Values, keys: IntArray, middle: Array, angle: float) -> Values:
    """The map with some of its variables reflected about a line."""
    double = 2.0 * angle
    reflection = np.array([[np.cos(double), np.sin(double)], [np.sin(double), -np.cos(double)]])
    out, kinds = values, values.layout.kinds[values.layout.index(keys)]
    for kind in map(Kind, np.unique(kinds).tolist()):
        mine = keys[kinds == kind]
        there = middle + (values.positions(mine, 2) - middle) @ reflection.T
        if kind.is_pose:
            turned = double - values.poses_of(mine, 2).xytheta()[:, 2:]
            out = out.update(Values.of({kind: (mine, Pose.from_xytheta(np.concatenate([there, turned], -1)))}))
        else:
            out = out.update(Values.of({kind: (mine, there)}))
    return out
