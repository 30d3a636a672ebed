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

from teamslam.geometry import Array, IntArray, Pose, directions, lift_points
from teamslam.joining.start.dead_reckoning import dead_reckoning
from teamslam.joining.start.odometry import odometry_links
from teamslam.model import Dataset, Table, is_landmark, variances
from teamslam.model.sensors import pose_of

MOST_STEPS = 20  # of odometry between two looks: beyond, its errors hide all others
MOST_PAIRS = 2000  # of one table: more are thinned evenly


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
    """A robot's way by odometry alone, and the variance of a step of it: of a length [m^2] and of an angle [rad^2]."""

    poses: Pose
    length_variance: float
    angle_variance: float


def pairs_of(piece: Dataset, robot: int, table: Table) -> Pairs:
    """Each look at a landmark with the next look at it, from another pose a few steps later."""
    chain = piece.pose_keys[robot]
    marks = np.flatnonzero(is_landmark(table.keys[:, -1]) & np.isin(table.keys[:, 0], chain))
    place = np.searchsorted(chain, table.keys[marks, 0])
    order = np.lexsort((place, table.keys[marks, -1]))
    rows, place = marks[order], place[order]
    steps = np.diff(place)
    same = (np.diff(table.keys[rows, -1]) == 0) & (steps > 0) & (steps <= MOST_STEPS)
    found = np.flatnonzero(same)
    found = found[:: max(-(-len(found) // MOST_PAIRS), 1)]
    return Pairs(rows[found], rows[found + 1], place[found], place[found + 1])


def way_of(piece: Dataset, robot: int) -> Way:
    """The way that a piece's odometry tells. ModelError where its chain is broken."""
    values = dead_reckoning(piece, robot)
    poses = values.poses_of(piece.pose_keys[robot], piece.robots[robot])
    which, row, _ = odometry_links(piece, robot, piece.pose_keys[robot])
    lengths, angles = [], []
    for number in np.unique(which[which >= 0]).tolist():
        table = piece.tables[number]
        rows = row[which == number] if len(table.whitening) > 1 else np.zeros(1, np.int64)
        found = variances(table.whitening[rows])
        lengths.append(found[:, : table.dim].mean(-1))
        angles.append(found[:, table.dim :].mean(-1))
    return Way(poses, float(np.median(np.concatenate(lengths))), float(np.median(np.concatenate(angles))))


def misfit(table: Table, pairs: Pairs, way: Way) -> Array:
    """How badly each triangle closes (n,): squared, over its variance and its numbers. Of sensors that people added,
    nothing (0,)."""
    if table.model not in TRIANGLES:
        return np.zeros(0)
    dim = max(table.dim, way.poses.dim)
    steps = way.poses[pairs.before].between(way.poses[pairs.after]).lift(dim)
    one, other = (Look.of(table, rows, dim) for rows in (pairs.first, pairs.second))
    count = (pairs.after - pairs.before).astype(float)
    return TRIANGLES[table.model](one, other, steps, count * way.length_variance, count * way.angle_variance)


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


def places(one: Look, other: Look, steps: Pose, length: Array, angle: Array) -> Array:
    """p_a = R p_b + t."""
    reach = np.maximum(one.distance, other.distance) ** 2
    of_looks = sum(look.length_variance + reach * look.angle_variance for look in (one, other))
    return np.asarray(np.mean((one.place - steps.act(other.place)) ** 2, -1) / (of_looks + length + reach * angle))


def ranges(one: Look, other: Look, steps: Pose, length: Array, angle: Array) -> Array:
    """| |p_a| - |p_b| | <= |t| <= |p_a| + |p_b|."""
    moved = np.linalg.norm(steps.translation, axis=-1)
    short, long = np.abs(one.distance - other.distance), one.distance + other.distance
    over = np.maximum(np.maximum(short - moved, moved - long), 0.0)
    return np.asarray(over**2 / (one.length_variance + other.length_variance + length))


def bearings(one: Look, other: Look, steps: Pose, length: Array, angle: Array) -> Array:
    """p_a lies on the arc from the direction of t to that of R p_b."""
    far = (steps.rotation @ other.direction[..., None])[..., 0]
    moved = np.linalg.norm(steps.translation, axis=-1)
    ahead = np.where(moved[:, None] > 0.0, steps.translation / np.maximum(moved, 1e-12)[:, None], far)
    across = ahead - np.sum(ahead * far, -1, keepdims=True) * far
    turned = np.linalg.norm(across, axis=-1)
    side = np.where(turned[:, None] > 1e-9, across / np.maximum(turned, 1e-12)[:, None], 0.0)
    # On the arc's great circle, as an angle from its far end towards t; the rest is off the circle.
    along = np.arctan2(np.sum(one.direction * side, -1), np.sum(one.direction * far, -1))
    arc = np.arctan2(turned, np.sum(ahead * far, -1))
    beyond = np.minimum(np.abs(along), np.abs(_wrapped(along - arc)))
    inside = (along >= 0.0) & (along <= arc)
    flat = np.hypot(np.sum(one.direction * side, -1), np.sum(one.direction * far, -1))
    off = np.arccos(np.clip(flat, 0.0, 1.0)) ** 2 + np.where(inside, 0.0, beyond**2)
    return np.asarray(off / (one.angle_variance + other.angle_variance + angle))


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


Triangle = Callable[[Look, Look, Pose, Array, Array], Array]
TRIANGLES: dict[str, Triangle] = {
    "relative_pose": places,
    "point": places,
    "range_bearing": places,
    "range": ranges,
    "bearing": bearings,
}
