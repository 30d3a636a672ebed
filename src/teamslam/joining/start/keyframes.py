"""A way thinned to the poses a start needs: of each bit along which little heading is lost, the pose that saw most.

Between two keyframes the odometry is one relative pose, with the covariance of all its steps. A step s of covariance
P_s, from pose X_s on, moves the end X of its bit, seen from its beginning B, by M_s = [A, C; 0, D] to first order:

    A = R_B' R_s ,   C = -R_B' R_(s+1) [r]x ,  r = R_(s+1)' (T - T_(s+1)) ,   D = R' R_(s+1)         sum_s M_s P_s M_s'
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, rotations
from teamslam.joining.start.odometry import heading_variances, odometry_links
from teamslam.model import Dataset, Layout, Table, Values, among, is_landmark, pack, whitening

BIT = 0.05  # [rad]: how far the heading may be lost from one keyframe to the next


@dataclass(frozen=True, eq=False)
class Sightings:
    """Rows of one table taken from keyframes: by which (m,), and of which landmark (m,)."""

    table: Table
    by: IntArray
    mark: IntArray


@dataclass(frozen=True, eq=False)
class Keyframes:
    """The keyframes (n,) of a robot's way: their places in it, poses, the variance of the heading (n - 1,) that the
    odometry adds from each to the next, that odometry as relative poses (keys are not set), and what was seen from them
    of the landmarks `marks` (sorted), of the kinds `mark_kinds`."""

    places: IntArray
    poses: Pose
    heading: Array
    steps: Table
    sightings: Sequence[Sightings]
    marks: IntArray
    mark_kinds: IntArray

    @classmethod
    def of(cls, piece: Dataset, robot: int, way: Values, kinds: Layout) -> "Keyframes":
        """Those of a way by dead reckoning in which each pose is linked to the next; `kinds` are those of the piece's
        variables."""
        keys, dim = way.layout.keys, piece.robots[robot]
        poses = way.poses_of(keys, dim)
        heading = heading_variances(piece, robot, keys)
        looks = [t for t in piece.tables if not t.row.unary]
        seen = [t.select(is_landmark(t.keys[:, -1]) & among(t.keys[:, 0], keys)) for t in looks]
        seen = [t for t in seen if len(t)]
        observers = np.searchsorted(keys, np.concatenate([*(t.keys[:, 0] for t in seen), np.zeros(0, np.int64)]))
        places = _chosen(heading, np.bincount(observers, minlength=len(keys)))
        marks = np.unique(np.concatenate([t.keys[:, 1] for t in seen] or [np.zeros(0, np.int64)]))
        sightings = []
        for table in seen:
            at = np.searchsorted(keys, table.keys[:, 0])
            by = np.searchsorted(places, at)
            kept = np.flatnonzero(places[np.minimum(by, len(places) - 1)] == at)
            if len(kept):
                part = table.select(kept)
                sightings.append(Sightings(part, by[kept], np.searchsorted(marks, part.keys[:, 1])))
        noise = _composed(_covariances(piece, robot, keys, dim), poses, places)
        along = pack(poses[places[:-1]].between(poses[places[1:]]))
        n = len(along)
        steps = Table(robot, "odometry", "relative_pose", dim, np.zeros((n, 2), np.int64), along, noise, np.arange(n))
        added = np.add.reduceat(np.append(heading, 0.0), places)[:-1]
        return cls(places, poses[places], added, steps, sightings, marks, kinds.kinds[kinds.index(marks)])


def _chosen(heading: Array, counts: IntArray) -> IntArray:
    """The first pose, and of each bit of the way the one that saw most, where it saw anything."""
    bit = np.floor(np.append(0.0, np.cumsum(heading)) / BIT**2).astype(np.int64)
    # A step that loses more than a bit by itself begins another.
    order = np.lexsort([-counts, bit])
    first = order[np.append(True, np.diff(bit[order]) > 0)]
    return np.union1d(first[counts[first] > 0], 0)


def _covariances(piece: Dataset, robot: int, keys: IntArray, dim: int) -> Array:
    """Of each odometry step (n - 1, dof, dof); what it leaves open is taken as loose."""
    which, row, _ = odometry_links(piece, robot, keys)
    dof = dim + rotations(dim).DOF
    shadow = np.arange(dof) if dim == 3 else np.array([0, 1, -1])
    out = np.zeros((len(which), dof, dof))
    for number in np.unique(which).tolist():
        steps, table = np.flatnonzero(which == number), piece.tables[number]
        roots = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))[row[steps]]
        information = np.swapaxes(roots, -1, -2) @ roots
        diagonal = np.einsum("nii->ni", information)
        diagonal += 1e-6 * diagonal + 1e-9 * diagonal.max(-1, keepdims=True)
        out[steps] = np.linalg.inv(information)[:, shadow[:, None], shadow]
    return out


def _composed(covariances: Array, poses: Pose, places: IntArray) -> Array:
    """The whitening (n - 1, dof, dof) of the odometry from each keyframe to the next."""
    if len(places) < 2:
        return np.zeros((0, *covariances.shape[1:]))
    d, group = poses.dim, rotations(poses.dim)
    steps = np.arange(places[0], places[-1])
    bit = np.searchsorted(places, steps, side="right") - 1
    before, after, end = poses[steps], poses[steps + 1], poses[places[bit + 1]]
    home = np.swapaxes(poses[places[bit]].rotation, -1, -2)
    lever = after.unact(end.translation)
    moved = np.zeros((len(steps), *covariances.shape[1:]))
    moved[:, :d, :d] = home @ before.rotation
    for k, axis in enumerate(np.eye(group.DOF)):
        moved[:, :d, d + k] = (home @ after.rotation @ (lever @ group.hat(axis).T)[..., None])[..., 0]
    moved[:, d:, d:] = group.adjoint(np.swapaxes(end.rotation, -1, -2) @ after.rotation)
    each = moved @ covariances[steps] @ np.swapaxes(moved, -1, -2)
    total = np.add.reduceat(each, places[:-1] - places[0])
    return whitening(0.5 * (total + np.swapaxes(total, -1, -2)))
