"""What a chain of submaps shows of the world that others may know too: places, orientations, and how sure they are.

A chain is a run of submaps in which each first pose but the first one's is known from one before; its frame is the
first one's. Along it uncertainty grows: a frame whose place and heading are known to s_T and s_R adds s_T^2 + s_R^2
|q|^2 to the variance of a place q in it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.frontend.tags.whole_poses import as_relative_poses
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose, lift_points, rotations
from teamslam.joining.start.targets import WHOLE, measured_positions
from teamslam.model import WORLD, Kind, Submap, Table, is_landmark, robot_of, unpack, variances
from teamslam.solver import Covariances

MOST_JOINT = 200  # landmarks whose covariance is taken together: a dense matrix


@dataclass(frozen=True, eq=False)
class Outline:
    """Per key (sorted, unique) a place (n, 3) with its variance (n,) [m^2], where it is `oriented` an orientation
    (n, 3, 3) with its variance (n,) [rad^2], and whether it is an `own` pose: known by its robot's odometry rather than
    by somebody's sighting of it."""

    keys: IntArray
    places: Array
    turns: Array
    oriented: BoolArray
    variances: Array
    turn_variances: Array
    own: BoolArray

    @classmethod
    def of(cls, *parts: "Outline") -> "Outline":
        """Several outlines in one frame together; of rows with one key own ones count before others, then the first."""
        columns = [np.concatenate(column) for column in zip(*(part.columns for part in parts), strict=True)]
        keys, own = columns[0], columns[-1]
        order = np.lexsort([np.arange(len(keys)), ~own, keys])
        first = order[np.concatenate([[True], keys[order][1:] != keys[order][:-1]])] if len(order) else order
        return cls(*(column[first] for column in columns))

    @classmethod
    def beside(cls, parts: Sequence["Outline"]) -> tuple["Outline", IntArray]:
        """All rows of several outlines, each in its own frame still, and which outline each row is from."""
        columns = [np.concatenate(column) for column in zip(*(part.columns for part in parts), strict=True)]
        return cls(*columns), np.repeat(np.arange(len(parts)), [len(part.keys) for part in parts])

    @property
    def columns(self) -> tuple[AnyArray, ...]:
        """The fields in their order."""
        return (self.keys, self.places, self.turns, self.oriented, self.variances, self.turn_variances, self.own)

    def at(self, index: AnyArray) -> "Outline":
        """The rows at a mask or index."""
        return Outline(*(column[index] for column in self.columns))

    def only(self, keys: IntArray) -> "Outline":
        """The rows of some keys."""
        return self.at(np.isin(self.keys, keys))

    def move(self, frame: Pose) -> "Outline":
        """The same things written in the frame that `frame` is written in."""
        lifted = frame.lift(3)
        return replace(self, places=lifted.act(self.places), turns=lifted.rotation @ self.turns)

    def loosen(self, place_variance: float, turn_variance: float) -> "Outline":
        """The same seen from where its frame itself is known only so well."""
        places = self.variances + place_variance + turn_variance * np.sum(self.places**2, -1)
        return replace(self, variances=places, turn_variances=self.turn_variances + turn_variance)


def outline_of_chain(
    submaps: Sequence[Submap], frames: Sequence[Pose], shared: IntArray, *, raw: bool = True
) -> Outline:
    """What a chain knows of the `shared` keys, in the frame of its first submap; `frames` are its submaps' bases
    there. `raw`: what its raw sightings show of others, too."""
    loose: dict[int, tuple[float, float]] = {}
    first = np.array([submap.first_pose for submap in submaps])
    parts = []
    for submap, frame in zip(submaps, frames, strict=True):
        sketch = _sketch(submap, np.union1d(shared, first), raw)
        placed = sketch.loosen(*_frame_of(sketch, submap.first_pose, loose)).move(frame)
        links = placed.only(first)
        for key, place, turn in zip(links.keys, links.variances, links.turn_variances, strict=True):
            loose.setdefault(int(key), (float(place), float(turn)))
        parts.append(placed)
    return Outline.of(*parts).only(shared)


def _frame_of(sketch: Outline, first: int, loose: Mapping[int, tuple[float, float]]) -> tuple[float, float]:
    """The variances of place and heading of a sketch's frame, by how well its first pose is known in the chain and in
    the sketch; none of the frame that is the chain's."""
    if first not in loose:
        return 0.0, 0.0
    (at,) = np.flatnonzero(sketch.keys == first)
    place, turn = loose[first]
    turn += float(sketch.turn_variances[at])
    return place + float(sketch.variances[at] + turn * np.sum(sketch.places[at] ** 2)), turn


def known_keys(submap: Submap) -> IntArray:
    """All that a submap's outline can show: its variables, its base, and the targets of its raw sightings."""
    return np.concatenate([submap.keys, *(t.keys[:, 1] for t in submap.raw if not t.row.unary)])


def _sketch(submap: Submap, wanted: IntArray, raw: bool) -> Outline:
    """Of a submap's own variables the `wanted` ones, then what its raw sightings show of others, if they are asked
    for."""
    values = submap.all_values
    there = np.isin(values.layout.keys, wanted)
    keys, poses = values.layout.keys[there], values.layout.kinds[there] < 2
    turns = np.tile(np.eye(3), (len(keys), 1, 1))
    turns[poses] = values.poses_of(keys[poses], 3).rotation
    own = poses & np.isin(robot_of(keys), submap.robots)
    parts = [Outline(keys, values.positions(keys, 3), turns, poses, *_variances(submap, keys), own)]
    for table in submap.raw if raw else ():
        table = as_relative_poses(table)
        if table.model not in (*WHOLE, "relative_pose"):
            continue
        whole = np.isfinite(variances(table.whitening)).all(-1)
        part = table.select(values.layout.contains(table.keys[:, 0]) & whole)
        if len(part):
            parts.append(_sighted(part, values.poses_of(part.keys[:, 0], 3)))
    return Outline.of(*parts)


def _sighted(table: Table, seen_by: Pose) -> Outline:
    """What raw sightings from known poses show."""
    n, d = len(table), table.dim
    each = variances(table.whitening)
    diagonal = np.broadcast_to(each, (n, each.shape[-1]))
    turns, turn_variances = np.tile(np.eye(3), (n, 1, 1)), np.ones(n)
    whole = table.model == "relative_pose"
    if whole:
        measured = unpack(table.values, Kind(d - 2))
        assert isinstance(measured, Pose)
        pose = seen_by @ (measured if table.sensor is None else table.sensor @ measured)
        places, turns = pose.translation, pose.rotation
        place_variances, turn_variances = diagonal[:, :d].mean(-1), diagonal[:, d:].mean(-1)
    else:
        places = seen_by.act(lift_points(measured_positions(table), 3))
        place_variances = diagonal[:, :d].mean(-1)
        if table.model == "range_bearing":
            place_variances = (diagonal[:, 0] + table.values[:, 0] ** 2 * diagonal[:, 1:].sum(-1)) / d
    return Outline(
        table.keys[:, 1], places, turns, np.full(n, whole), place_variances, turn_variances, np.zeros(n, bool)
    )


def _variances(submap: Submap, keys: IntArray) -> tuple[Array, Array]:
    """The mean variances (n,) of some variables' places and orientations; of the base, which is the frame, 0."""
    out = np.zeros((2, len(keys)))
    layout, covariances = submap.values.layout, Covariances.of_map(submap)
    known = np.flatnonzero(layout.contains(keys))
    kinds = layout.kinds[layout.index(keys[known])]
    blocks = covariances.blocks(keys[known])
    for kind in map(Kind, np.unique(kinds).tolist()):
        rows = np.flatnonzero(kinds == kind)
        diagonals = np.diagonal(np.stack([blocks[row] for row in rows]), axis1=-2, axis2=-1)
        out[0, known[rows]] = diagonals[:, : kind.dim].mean(-1)
        if kind.is_pose:
            out[1, known[rows]] = diagonals[:, kind.dim :].mean(-1)
    marks = np.flatnonzero(is_landmark(keys) & (keys != WORLD))
    if 2 < len(marks) <= MOST_JOINT:
        out[0, marks] = np.minimum(out[0, marks], _among_themselves(submap, covariances, keys[marks]))
    return out[0], out[1]


def _among_themselves(submap: Submap, covariances: Covariances, marks: IntArray) -> Array:
    """The variances of landmarks relative to each other, (n,): what is left when all of them may move as one body.

    How well a robot knows them from its first pose does not matter for laying two maps on each other.
    """
    kinds = submap.values.layout.kinds[submap.values.layout.index(marks)]
    d = 2 if (kinds % 2 == 0).all() else 3
    starts = np.concatenate([[0], np.cumsum(submap.values.layout.dofs[submap.values.layout.index(marks)])])[:-1]
    places = (starts[:, None] + np.minimum(np.arange(d), [[Kind(int(k)).dim - 1] for k in kinds])).ravel()
    joint = covariances.joint(marks)[np.ix_(places, places)]
    points = submap.values.positions(marks, d)
    turns = [rotations(d).hat(axis) for axis in np.eye(rotations(d).DOF)]
    as_one = np.concatenate(
        [np.tile(np.eye(d), (len(marks), 1)), np.stack([(points @ w.T).ravel() for w in turns], 1)], 1
    )
    basis, _ = np.linalg.qr(as_one)
    # diag(P C P) with P = 1 - B B', without forming P.
    along = joint @ basis
    left = np.diagonal(joint) - np.sum(basis * (2.0 * along - basis @ (basis.T @ along)), 1)
    left = np.maximum(left, 0.0).reshape(-1, d).mean(-1)
    return np.asarray(left * len(joint) / max(len(joint) - basis.shape[1], 1))
