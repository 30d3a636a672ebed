"""Sightings that tell how their target stands: relative poses, and corners by the pose that fits them best."""

from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, concatenate, so3
from teamslam.geometry.resection import resect, slopes
from teamslam.model import Kind, Table, pack, unpack, whitening_of_information

CUT = 50.0  # of the squared residual of one sighting: beyond it is a misread, or another place
MOST = 12  # sightings of one target that vote on its place


def tells_pose(table: Table) -> bool:
    """Whether a row of a table tells the pose of its target in its observer."""
    return table.row.targets_pose and not table.row.unary


def hypotheses(table: Table) -> tuple[Pose, Array]:
    """Poses of the targets in their observers' bodies (m, 2), in space, and their costs (m, 2); the second is infinite
    where there is but one that fits."""
    if table.model == "corners":
        rays, points = (table.values[:, part].reshape(-1, 4, 3) for part in (slice(0, 12), slice(12, 24)))
        found = resect(rays, points, table.whitening)
        poses, costs = found.poses, found.costs
    else:
        measured = unpack(table.values, Kind(table.dim - 2))
        assert isinstance(measured, Pose)
        poses = measured.lift(3)[:, None]
        poses = Pose(np.repeat(poses.rotation, 2, 1), np.repeat(poses.translation, 2, 1))
        costs = np.stack([np.zeros(len(table)), np.full(len(table), np.inf)], 1)
    return (poses if table.sensor is None else table.sensor.lift(3)[None, None] @ poses), costs


def as_relative_poses(table: Table) -> Table:
    """Corners as relative poses, each with what its corners tell of it at the pose that fits best; other tables as they
    are."""
    if table.model != "corners" or not len(table):
        return table
    rays, points = (table.values[:, part].reshape(-1, 4, 3) for part in (slice(0, 12), slice(12, 24)))
    best = resect(rays, points, table.whitening).poses[:, 0]
    J = table.whitening @ slopes(best, rays, points)[1]
    noise = whitening_of_information(np.swapaxes(J, -1, -2) @ J)
    return replace(table, model="relative_pose", values=pack(best), whitening=noise)


def voted(table: Table, observers: Pose) -> tuple[IntArray, Pose]:
    """The targets (t,) of a table and where each stands (t,), seen from `observers` (m,) in space: of all that some of
    its rows may stand for, what they agree with best. Squared residuals count up to CUT: a misread has one voice."""
    targets, _, stand = voted_but(table, observers, None, 0.0)
    return targets, stand


def voted_but(table: Table, observers: Pose, known: Pose | None, turned: float) -> tuple[IntArray, BoolArray, Pose]:
    """The same, of what each row may stand for that is turned by more than `turned` [rad] against what is `known` of
    its target (m,); and for which targets (t,) there is anything."""
    targets, of = np.unique(table.keys[:, 1], return_inverse=True)
    order = np.argsort(of, kind="stable")
    each = np.split(order, np.searchsorted(of[order], np.arange(1, len(targets))))
    some = [rows[np.unique(np.linspace(0, len(rows) - 1, min(MOST, len(rows))).astype(int))] for rows in each]
    asked = np.concatenate([np.zeros(0, np.int64), *some])
    part, eyes = table.select(asked), observers[asked]
    poses, costs = hypotheses(part)
    if known is not None:
        here = np.swapaxes(known.rotation[asked], -1, -2)[:, None] @ (eyes.rotation[:, None] @ poses.rotation)
        costs = np.where(np.linalg.norm(so3.log(here), axis=-1) > turned, costs, np.inf)
    ends = np.cumsum([len(rows) for rows in some])
    spans = [np.arange(end - len(own), end) for own, end in zip(some, ends.tolist(), strict=True)]
    some_pose = np.array([np.isfinite(costs[rows]).any() for rows in spans], bool)
    stand = [
        _agreed(part.select(rows), eyes[rows], poses[rows], costs[rows]) if any_ else Pose.identity(3, (1,))
        for rows, any_ in zip(spans, some_pose.tolist(), strict=True)
    ]
    return targets, some_pose, concatenate(stand) if stand else Pose.identity(3, (0,))


def _agreed(part: Table, eyes: Pose, poses: Pose, costs: Array) -> Pose:
    """Of what the rows of one target may stand for (k, 2), seen from `eyes` (k,), that on which they agree best."""
    which, hypothesis = np.nonzero(np.isfinite(costs))
    tried = eyes[which] @ Pose(poses.rotation[which, hypothesis], poses.translation[which, hypothesis])
    c, k = len(tried), len(part)
    h = part.predict_from(eyes[np.tile(np.arange(k), c)], tried[np.repeat(np.arange(c), k)])
    error = part.row.minus(np.tile(part.values, (c, 1)), h, part.dim).reshape(c, k, -1)
    white = (part.whitening @ error[..., None])[..., 0]
    votes = np.minimum(np.sum(white**2, -1), CUT).sum(1)
    return tried[[int(np.argmin(votes))]]
