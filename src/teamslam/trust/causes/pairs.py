"""Two sightings of one landmark and the odometry between them: a triangle that must close, before anything is solved.

From pose a the landmark is at p_a, from the robot's next look at it, at p_b; odometry leads from a to b by T = (R, t).
Then p_a = R p_b + t to within the noise of all three. Less is known of less than a position, but something still is:

    range      | |p_a| - |p_b| |  <=  |t|  <=  |p_a| + |p_b|
    bearing    p_a / |p_a| lies between the directions of t and of R p_b

What is left is squared, in the variance that sightings and odometry state, and divided by how many numbers it is. A log
without a mistake has a median of about 1 or less; one with a wrong sign, unit or axis has hundreds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray, Pose, compose_along, directions, lift_points
from teamslam.joining.start.dead_reckoning import steps_along
from teamslam.joining.start.odometry import odometry_links
from teamslam.model import Dataset, Table, is_landmark, variances
from teamslam.model.sensors import pose_of

MOST_STEPS = 20  # of odometry between two looks: beyond, its errors hide all others
MOST_PAIRS = 2000  # of one table: more are thinned evenly
FAR = 25.0  # of what a triangle is off: what is more is as bad
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Pairs:
    """Rows `first` and `second` (n,) of a table: two looks at one landmark, from places `before` and `after` (n,) in
    the robot's chain of poses."""

    first: IntArray
    second: IntArray
    before: IntArray
    after: IntArray

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True, eq=False)
class Way:
    """A robot's way by odometry alone, and the variance of a step of it: of a length [m^2] and of an angle [rad^2].
    Poses (n,) whose `runs` (n,) differ are linked by nothing."""

    poses: Pose
    runs: IntArray
    length_variance: float
    angle_variance: float


def pairs_of(piece: Dataset, robot: int, table: Table, runs: IntArray | None = None) -> Pairs:
    """Each look at a landmark with the next look at it, from another pose a few steps later in the same of the way's
    `runs`. Of sensors that people added, nothing."""
    chain = piece.pose_keys[robot]
    if table.model not in TRIANGLES:
        return Pairs(*np.zeros((4, 0), np.int64))
    marks = np.flatnonzero(is_landmark(table.keys[:, -1]) & np.isin(table.keys[:, 0], chain))
    place = np.searchsorted(chain, table.keys[marks, 0])
    order = np.lexsort((place, table.keys[marks, -1]))
    rows, place = marks[order], place[order]
    steps = np.diff(place)
    same = (np.diff(table.keys[rows, -1]) == 0) & (steps > 0) & (steps <= MOST_STEPS)
    if runs is not None:
        same &= np.diff(runs[place]) == 0
    found = np.flatnonzero(same)
    found = found[:: max(-(-len(found) // MOST_PAIRS), 1)]
    return Pairs(rows[found], rows[found + 1], place[found], place[found + 1])


def way_of(piece: Dataset, robot: int) -> Way:
    """The way that a piece's odometry tells. ModelError where there is no odometry at all."""
    chain, dim = piece.pose_keys[robot], piece.robots[robot]
    which, row, backward = odometry_links(piece, robot, chain)
    if not (which >= 0).any():
        raise ModelError(f"robot {piece.names.robot(robot)} has no odometry")
    poses = compose_along(steps_along(piece, dim, which, row, backward))
    lengths, angles = [], []
    for number in np.unique(which[which >= 0]).tolist():
        table = piece.tables[number]
        rows = row[which == number] if len(table.whitening) > 1 else np.zeros(1, np.int64)
        found = variances(table.whitening[rows])
        lengths.append(found[:, : table.dim].mean(-1))
        angles.append(found[:, table.dim :].mean(-1))
    runs = np.concatenate([[0], np.cumsum(which < 0)])
    return Way(poses, runs, float(np.median(np.concatenate(lengths))), float(np.median(np.concatenate(angles))))


@dataclass(frozen=True, eq=False)
class Closing:
    """How triangles close: `off` (n,), squared, over its variance and its numbers; `unlikely` (n,), -2 log of how
    likely the first look is, given the second and the odometry, with what is `off` counted up to FAR."""

    off: Array
    unlikely: Array


def closing(table: Table, pairs: Pairs, way: Way) -> Closing:
    """How each triangle closes."""
    if not len(pairs):
        return Closing(np.zeros(0), np.zeros(0))
    dim = max(table.dim, way.poses.dim)
    steps = way.poses[pairs.before].between(way.poses[pairs.after]).lift(dim)
    one, other = (Look.of(table, rows, dim) for rows in (pairs.first, pairs.second))
    count = (pairs.after - pairs.before).astype(float)
    of_odometry = count * way.length_variance, count * way.angle_variance
    off, numbers, room = TRIANGLES[table.model](one, other, steps, *of_odometry)
    if table.model == "range_bearing":
        room = room - 2.0 * (table.dim - 1) * np.log(np.maximum(one.distance, TINY))
    return Closing(off, numbers * np.minimum(off, FAR) + room)


@dataclass(frozen=True, eq=False)
class Look:
    """What is known of where landmarks are from the robot's body: `distance` (n,) and unit vectors `direction` (n, d),
    1 and 0 where they are not seen; the variances of a length (n,) and of an angle (n,); how they are turned
    (n, d, d), where that is seen."""

    distance: Array
    direction: Array
    length_variance: Array
    angle_variance: Array
    turn: Array | None = None

    @classmethod
    def of(cls, table: Table, rows: IntArray, dim: int) -> "Look":
        """Some rows of a table, in a body of dimension `dim`."""
        z, none = table.values[rows], np.zeros(len(rows))
        spread = variances(table.whitening if len(table.whitening) == 1 else table.whitening[rows])
        spread = np.broadcast_to(spread, (len(rows), spread.shape[-1]))
        if table.model == "range":
            return cls(z[:, 0], np.zeros((len(rows), dim)), spread[:, 0], none)
        if table.model in ("bearing", "range_bearing"):
            seen = table.model == "range_bearing"
            distance = z[:, 0] if seen else np.ones(len(rows))
            where = distance[:, None] * directions(table.dim).ray(z[:, seen:])
            length, angle = spread[:, 0] if seen else none, spread[:, seen:].mean(-1)
        else:
            where, length, angle = z[:, : table.dim], spread[:, : table.dim].mean(-1), none
        body = lift_points(where, dim)
        if table.sensor is not None:
            mount = table.sensor.lift(dim)
            body = mount.act(body) if table.model != "bearing" else body @ mount.rotation.T
        distance, turn = np.linalg.norm(body, axis=-1), None
        if table.row.targets_pose:
            pose = pose_of(z, table.dim).lift(dim)
            turn = (pose if table.sensor is None else table.sensor.lift(dim) @ pose).rotation
        return cls(distance, body / np.maximum(distance, 1e-12)[:, None], length, angle, turn)

    @property
    def place(self) -> Array:
        """Where each landmark is (n, d), seen from the body."""
        return self.distance[:, None] * self.direction


Closed = tuple[Array, int, Array]
"""What a triangle is off, of how many numbers, and -2 log of the density at its middle."""


def places(one: Look, other: Look, steps: Pose, length: Array, angle: Array) -> Closed:
    """p_a = R p_b + t."""
    reach = np.maximum(one.distance, other.distance) ** 2
    of_looks = sum(look.length_variance + reach * look.angle_variance for look in (one, other))
    variance, dim = of_looks + length + reach * angle, steps.dim
    off = np.mean((one.place - steps.act(other.place)) ** 2, -1) / variance
    return np.asarray(off), dim, dim * np.log(2.0 * np.pi * variance)


def ranges(one: Look, other: Look, steps: Pose, length: Array, angle: Array) -> Closed:
    """| |p_a| - |p_b| | <= |t| <= |p_a| + |p_b|: |p_a| lies anywhere in an interval."""
    moved = np.linalg.norm(steps.translation, axis=-1)
    short, long = np.abs(one.distance - other.distance), one.distance + other.distance
    over = np.maximum(np.maximum(short - moved, moved - long), 0.0)
    variance = one.length_variance + other.length_variance + length
    room = 2.0 * np.minimum(moved, other.distance) + np.sqrt(2.0 * np.pi * variance)
    return np.asarray(over**2 / variance), 1, 2.0 * np.log(room)


def bearings(one: Look, other: Look, steps: Pose, length: Array, angle: Array) -> Closed:
    """p_a lies anywhere on the arc from the direction of t to that of R p_b."""
    far = (steps.rotation @ other.direction[..., None])[..., 0]
    moved = np.linalg.norm(steps.translation, axis=-1)
    ahead = np.where(moved[:, None] > 0.0, steps.translation / np.maximum(moved, TINY)[:, None], far)
    across = ahead - np.sum(ahead * far, -1, keepdims=True) * far
    turned = np.linalg.norm(across, axis=-1)
    side = np.where(turned[:, None] > 1e-9, across / np.maximum(turned, TINY)[:, None], 0.0)
    # On the arc's great circle, as an angle from its far end towards t; the rest is off the circle.
    along = np.arctan2(np.sum(one.direction * side, -1), np.sum(one.direction * far, -1))
    arc = np.arctan2(turned, np.sum(ahead * far, -1))
    beyond = np.minimum(np.abs(along), np.abs(_wrapped(along - arc)))
    inside = (along >= 0.0) & (along <= arc)
    flat = np.hypot(np.sum(one.direction * side, -1), np.sum(one.direction * far, -1))
    off = np.arccos(np.clip(flat, 0.0, 1.0)) ** 2 + np.where(inside, 0.0, beyond**2)
    variance, beside = one.angle_variance + other.angle_variance + angle, steps.dim - 2
    room = 2.0 * np.log(arc + np.sqrt(2.0 * np.pi * variance)) + beside * np.log(2.0 * np.pi * variance)
    return np.asarray(off / variance), 1, room


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


Triangle = Callable[[Look, Look, Pose, Array, Array], Closed]
TRIANGLES: dict[str, Triangle] = {
    "relative_pose": places,
    "point": places,
    "range_bearing": places,
    "range": ranges,
    "bearing": bearings,
}
