"""A start for a robot in space whose odometry says little: where it was, by the targets that it saw as poses.

    seed:    the pose that saw most targets is the frame
    spread:  forwards and backwards in time, a pose that sees a target that has a place gets its own, and gives the
             targets that it sees theirs, until nothing more is reached
    leap:    what no target leads to hangs on odometry: the next pose, and on from there
    again:   with everything in its place, each target and each pose is chosen once more

A sighting may stand for two poses that fit alike (a small tag seen from the front): each is a candidate, and so is that
of every other sighting; the one counts that all sightings of the target (or from the pose) agree with best. Votes are
squared residuals cut at CUT, so a misread has one voice. In space only: on the ground odometry keeps more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.frontend.tags.corner_errors import CornerErrors
from teamslam.frontend.tags.whole_poses import CUT, MOST, hypotheses, tells_pose
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.model import Kind, Table, Values, is_landmark

STEPS, STEP = 3, 1e-6  # of the refinement, and of its differences
MOVED = Pose.identity(3, (12,)).retract(np.concatenate([STEP * np.eye(6), -STEP * np.eye(6)]))
MOTION_CUT = 16.0  # of how unlikely a turn may make a pose
WIDEST = 8  # rows of a residual: those of corners


def by_targets(tables: Sequence[Table], way: Values, variances: Array) -> Values | None:
    """The robot's poses and the targets that it saw, in the frame of its first pose; None where it saw none as poses.

    `way` holds all its poses as odometry has them, `variances` (n - 1,) what each of its steps adds to a heading.
    """
    looks = _Looks.of(tables, way)
    if not len(looks.frame):
        return None
    found = _Search(looks, way.poses_of(way.layout.keys, 3), np.where(np.isfinite(variances), variances, np.pi**2))
    found.spread()
    found.again()
    poses = found.filled()
    first = poses[:1].inverse()
    seen = np.flatnonzero(found.has_place)
    targets = first[np.zeros(len(seen), np.int64)] @ found.places[seen]
    return Values.of({Kind.POSE3: (np.concatenate([way.layout.keys, looks.marks[seen]]),
                                   concatenate([first[np.zeros(len(poses), np.int64)] @ poses, targets]))})  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Looks:
    """Sightings (m,) of landmarks as poses: from which pose, of which landmark, by which row of which table, with what
    each may stand for (m, 2)."""

    tables: Sequence[Table]
    marks: IntArray
    frame: IntArray
    mark: IntArray
    table: IntArray
    row: IntArray
    poses: Pose
    costs: Array

    @classmethod
    def of(cls, tables: Sequence[Table], way: Values) -> "_Looks":
        keys = way.layout.keys
        seen = [t for t in tables if tells_pose(t)]
        seen = [t.select(is_landmark(t.keys[:, 1]) & way.layout.contains(t.keys[:, 0])) for t in seen]
        seen = [t for t in seen if len(t)]
        none = np.zeros(0, np.int64)
        marks = np.unique(np.concatenate([none, *(t.keys[:, 1] for t in seen)]))
        told = [hypotheses(t) for t in seen]
        return cls(
            seen,
            marks,
            np.concatenate([none, *(np.searchsorted(keys, t.keys[:, 0]) for t in seen)]),
            np.concatenate([none, *(np.searchsorted(marks, t.keys[:, 1]) for t in seen)]),
            np.concatenate([none, *(np.full(len(t), k) for k, t in enumerate(seen))]),
            np.concatenate([none, *(np.arange(len(t)) for t in seen)]),
            concatenate([poses for poses, _ in told]) if told else Pose.identity(3, (0, 2)),
            np.concatenate([np.zeros((0, 2)), *(costs for _, costs in told)]),
        )

    @cached_property
    def _corners(self) -> tuple[CornerErrors, IntArray]:
        """The sightings of corners, and which of them each sighting (m,) is; -1 of others."""
        which = [k for k, table in enumerate(self.tables) if table.model == "corners"]
        place = np.full(len(self.table), -1)
        own = np.isin(self.table, which)
        place[own] = np.arange(np.count_nonzero(own))
        return CornerErrors.of([self.tables[k] for k in which]), place

    def errors(self, rows: IntArray, observers: Pose, targets: Pose) -> Array:
        """Whitened residuals (c, k, WIDEST) of some sightings (k,) at poses of both ends, (c, k), (1, k) or (c, 1)
        each; zeros beyond a model's own."""
        corners, place = self._corners
        own = place[rows]
        if (own >= 0).all():
            return corners.at(own, observers, targets)
        shape = np.broadcast_shapes(observers.batch, targets.batch, (1, len(rows)))
        ends = [Pose(np.broadcast_to(X.rotation, (*shape, 3, 3)), np.broadcast_to(X.translation, (*shape, 3)))
                for X in (observers, targets)]  # fmt: skip
        out = np.zeros((*shape, WIDEST))
        for number in np.unique(self.table[rows]).tolist():
            at = np.flatnonzero(self.table[rows] == number)
            part = self.tables[number].select(self.row[rows[at]])
            for c in range(shape[0]):
                error = part.row.minus(part.values, part.predict_from(*(X[c][at] for X in ends)), part.dim)
                out[c, at, : error.shape[1]] = (part.whitening @ error[..., None])[..., 0]
        return out

    def candidates(self, rows: IntArray) -> tuple[IntArray, Pose]:
        """What some sightings may stand for: the sighting (as a place in `rows`) and the pose of each."""
        which, hypothesis = np.nonzero(np.isfinite(self.costs[rows]))
        return which, Pose(
            self.poses.rotation[rows[which], hypothesis], self.poses.translation[rows[which], hypothesis]
        )


class _Search:
    """Which poses and targets have a place already, and where."""

    def __init__(self, looks: _Looks, reckoned: Pose, variances: Array) -> None:
        n, m = len(reckoned), len(looks.marks)
        self.looks, self.reckoned = looks, reckoned
        self.variance = np.concatenate([[0.0], np.cumsum(variances)])
        self.poses, self.has_pose = Pose.identity(3, (n,)), np.zeros(n, bool)
        self.places, self.has_place = Pose.identity(3, (m,)), np.zeros(m, bool)
        self.of_frame = _groups(looks.frame, n)
        self.of_mark = _groups(looks.mark, m)

    def spread(self) -> None:
        """Until every pose that saw something has its place."""
        seeing = np.array([len(rows) > 0 for rows in self.of_frame])
        count = np.array([len(np.unique(self.looks.mark[rows])) for rows in self.of_frame])
        self._put_frame(int(np.argmax(count)), Pose.identity(3, (1,)))
        self._place_targets(int(np.argmax(count)))
        while True:
            while self._sweep(np.arange(len(seeing))) + self._sweep(np.arange(len(seeing))[::-1]):
                pass
            open_ = np.flatnonzero(seeing & ~self.has_pose)
            if not len(open_):
                return
            known = np.flatnonzero(self.has_pose)
            gap = np.abs(open_[:, None] - known[None])
            nearest = np.unravel_index(np.argmin(gap), gap.shape)
            frame, before = int(open_[nearest[0]]), int(known[nearest[1]])
            self._put_frame(frame, self._reckon(frame, before))
            self._place_targets(frame)

    def again(self) -> None:
        """Targets, then poses, of which a sighting does not fit: chosen once more with all that is known now."""
        for mark in np.unique(self.looks.mark[self._misfits()]).tolist():
            self._place_target(mark)
        for frame in np.unique(self.looks.frame[self._misfits()]).tolist():
            self._place_frame(frame)

    def _misfits(self) -> IntArray:
        looks, every = self.looks, np.arange(len(self.looks.frame))
        errors = looks.errors(every, self.poses[looks.frame][None], self.places[looks.mark][None])[0]
        return np.flatnonzero(np.sum(errors**2, -1) > CUT)

    def filled(self) -> Pose:
        """All poses: those without a place hang on the last one before that has one (else the first after)."""
        known = np.flatnonzero(self.has_pose)
        all_ = np.arange(len(self.has_pose))
        before = known[np.maximum(np.searchsorted(known, all_, "right") - 1, 0)]
        return self.poses[before] @ self.reckoned[before].between(self.reckoned[all_])

    def _sweep(self, frames: IntArray) -> int:
        done = 0
        for frame in frames.tolist():
            if len(self.of_frame[frame]) and not self.has_pose[frame] and self._place_frame(frame):
                self._place_targets(frame)
                done += 1
        return done

    def _reckon(self, frame: int, before: int) -> Pose:
        return self.poses[[before]] @ self.reckoned[[before]].between(self.reckoned[[frame]])

    def _put_frame(self, frame: int, pose: Pose) -> None:
        self.poses = _with(self.poses, frame, pose)
        self.has_pose[frame] = True

    def _place_frame(self, frame: int) -> bool:
        """A pose by the targets with a place that are seen from it; False where there are none."""
        rows = self.of_frame[frame]
        rows = rows[self.has_place[self.looks.mark[rows]]]
        if not len(rows):
            return False
        which, seen = self.looks.candidates(rows)
        tried = self.places[self.looks.mark[rows[which]]] @ seen.inverse()
        errors = self._errors(rows, tried, True)
        best = int(np.argmin(_agreed(errors) + self._unlikely(frame, tried)))
        self._put_frame(frame, self._refined(rows, tried[[best]], errors[[best]], from_frame=True))
        return True

    def _place_targets(self, frame: int) -> None:
        for mark in np.unique(self.looks.mark[self.of_frame[frame]]).tolist():
            if not self.has_place[mark]:
                self._place_target(mark)

    def _place_target(self, mark: int) -> None:
        rows = self.of_mark[mark]
        rows = rows[self.has_pose[self.looks.frame[rows]]]
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(MOST, len(rows))).astype(int))]
        which, seen = self.looks.candidates(rows)
        tried = self.poses[self.looks.frame[rows[which]]] @ seen
        errors = self._errors(rows, tried, False)
        best = int(np.argmin(_agreed(errors)))
        place = self._refined(rows, tried[[best]], errors[[best]], from_frame=False)
        self.places = _with(self.places, mark, place)
        self.has_place[mark] = True

    def _unlikely(self, frame: int, tried: Pose) -> Array:
        """How far each pose (c,) is from where odometry leads from the last pose before, in turns only, squared."""
        before = np.flatnonzero(self.has_pose[:frame])
        if not len(before):
            return np.zeros(len(tried))
        last = int(before[-1])
        steps = self.reckoned.rotation[last].T @ self.reckoned.rotation[frame]
        turned = (self.poses.rotation[last] @ steps).T @ tried.rotation
        variance = max(self.variance[frame] - self.variance[last], 1e-6)
        return np.asarray(np.minimum(_angles(turned) ** 2 / variance, MOTION_CUT))

    def _refined(self, rows: IntArray, pose: Pose, error: Array, *, from_frame: bool) -> Pose:
        """A few Gauss-Newton steps of one pose, with residuals `error` (1, k, WIDEST), on the sightings that agree with
        it, by differences of their squares."""
        for _ in range(STEPS):
            good = np.sum(error[0] ** 2, -1) < CUT
            moved = Pose(pose.rotation @ MOVED.rotation, pose.translation + MOVED.translation)
            both = self._errors(rows, moved, from_frame)
            J = ((both[6:] - both[:6]) / (2.0 * STEP))[:, good].reshape(6, -1)
            normal = J @ J.T
            damped = normal + np.diag(1e-6 * np.diag(normal) + 1e-12)
            step = np.linalg.solve(damped, J @ error[0][good].ravel())
            tried = pose.retract(step[None])
            error_tried = self._errors(rows, tried, from_frame)
            if _agreed(error_tried)[0] >= _agreed(error)[0]:
                return pose
            pose, error = tried, error_tried
        return pose

    def _errors(self, rows: IntArray, tried: Pose, from_frame: bool) -> Array:
        """Whitened residuals (c, k, WIDEST) of sightings (k,), were the pose (or target) each of those tried (c,)."""
        tried = tried[:, None]
        if from_frame:
            return self.looks.errors(rows, tried, self.places[self.looks.mark[rows]][None])
        return self.looks.errors(rows, self.poses[self.looks.frame[rows]][None], tried)


def _agreed(errors: Array) -> Array:
    """Squared residuals, each cut, summed over the sightings."""
    return np.asarray(np.minimum(np.sum(errors**2, -1), CUT).sum(-1))


def _angles(turns: Array) -> Array:
    """By how much rotations (c, 3, 3) turn (c,) [rad]."""
    skew = turns - np.swapaxes(turns, -1, -2)  # 2 sin times the axis, each number twice
    sine = np.sqrt(0.125 * np.sum(skew * skew, (-2, -1)))
    return np.asarray(np.arctan2(sine, 0.5 * (np.trace(turns, axis1=-2, axis2=-1) - 1.0)))


def _groups(of: IntArray, count: int) -> list[IntArray]:
    """The places of each number 0..count-1 in an array."""
    order = np.argsort(of, kind="stable")
    return np.split(order, np.searchsorted(of[order], np.arange(1, count)))


def _with(poses: Pose, place: int, one: Pose) -> Pose:
    """The poses with another one (a batch of one) at a place."""
    rotation, translation = poses.rotation.copy(), poses.translation.copy()
    rotation[place], translation[place] = one.rotation[0], one.translation[0]
    return Pose(rotation, translation)
