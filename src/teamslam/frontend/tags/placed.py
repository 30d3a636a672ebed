"""Which poses of a way and which targets have a place, and the ways in which they get one."""

from collections.abc import Callable

import numpy as np

from teamslam.frontend.tags.looks import Looks
from teamslam.frontend.tags.whole_poses import CUT, MOST
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.model import Kind, Values

TURNED = 0.2  # [rad]: a pose that is turned by more is another
LESS = 1.0  # of the cost: what is worth a change
MOTION_CUT = 16.0  # of how unlikely a turn may make a pose


class Placed:
    """Poses (n,) and places of targets (m,) in the frame of the first that was put, and which of them are there."""

    def __init__(self, looks: Looks, way: Values, variances: Array) -> None:
        self.keys = way.layout.keys
        n, m = len(self.keys), len(looks.marks)
        self.looks, self.reckoned = looks, way.poses_of(self.keys, 3)
        self.variance = np.concatenate([[0.0], np.cumsum(variances)])
        self.poses, self.has_pose = Pose.identity(3, (n,)), np.zeros(n, bool)
        self.places, self.has_place = Pose.identity(3, (m,)), np.zeros(m, bool)
        self.sightings = np.zeros(m, np.int64)  # of targets, from poses that have a place
        self.order: list[int] = []  # in which poses got their places
        self.of_frame = groups(looks.frame, n)
        self.of_mark = groups(looks.mark, m)

    def put_frame(self, frame: int, pose: Pose) -> None:
        """A pose at its place, and the targets that are seen from it where they have none."""
        self.poses = _exchanged(self.poses, frame, pose)
        self.has_pose[frame] = True
        np.add.at(self.sightings, self.looks.mark[self.of_frame[frame]], 1)
        self.order.append(frame)
        for mark in np.unique(self.looks.mark[self.of_frame[frame]]).tolist():
            if not self.has_place[mark]:
                self.place_target(mark)

    def reckoned_from(self, frame: int, before: int) -> Pose:
        """Where odometry leads from one pose to another."""
        return self.poses[[before]] @ self.reckoned[[before]].between(self.reckoned[[frame]])

    def filled(self) -> Pose:
        """All poses: those without a place hang on the last one before that has one (else the first after)."""
        known = np.flatnonzero(self.has_pose)
        all_ = np.arange(len(self.has_pose))
        before = known[np.maximum(np.searchsorted(known, all_, "right") - 1, 0)]
        return self.poses[before] @ self.reckoned[before].between(self.reckoned[all_])

    def found(self, frame: int) -> Pose | None:
        """Where a pose is by the targets with a place that are seen from it; None where there are none."""
        rows = self.of_frame[frame]
        rows = rows[self.has_place[self.looks.mark[rows]]]
        if not len(rows):
            return None
        which, seen = self.looks.candidates(rows)
        tried = self.places[self.looks.mark[rows[which]]] @ seen.inverse()
        cost = self._votes(rows, tried, from_frame=True) + self._unlikely(frame, tried)
        return tried[[int(np.argmin(cost))]]

    def place_target(self, mark: int, other: bool = False) -> None:
        """A target where its sightings agree best that it stands; `other`: of all poses but those near its own."""
        rows = self.of_mark[mark]
        rows = some(rows[self.has_pose[self.looks.frame[rows]]])
        which, seen = self.looks.candidates(rows)
        tried = self.poses[self.looks.frame[rows[which]]] @ seen
        votes = self._votes(rows, tried, from_frame=False)
        if other:
            turn = tried.minus(self.places[np.full(len(tried), mark)])[:, 3:]
            votes[np.linalg.norm(turn, axis=1) < TURNED] = np.inf
        self.places = _exchanged(self.places, mark, tried[[int(np.argmin(votes))]])
        self.has_place[mark] = True

    def lost(self, mark: int) -> bool:
        """Whether no sighting fits a target where it is."""
        rows = self.of_mark[mark]
        return bool((self.squared(some(rows[self.has_pose[self.looks.frame[rows]]])) > CUT).all())

    def turn_target(self, mark: int, latest: IntArray) -> None:
        """A target where it may stand otherwise, and those of the latest poses that see it where that leads them."""
        self.place_target(mark, other=True)
        for frame in latest.tolist():
            if (self.looks.mark[self.of_frame[frame]] == mark).any():
                pose = self.found(frame)
                assert pose is not None  # the target has a place
                self.poses = _exchanged(self.poses, frame, pose)

    def values(self, frames: IntArray, marks: IntArray) -> Values:
        """Some poses and targets that have a place, as variables."""
        keys = np.concatenate([self.keys[frames], self.looks.marks[marks]])
        return Values.of({Kind.POSE3: (keys, concatenate([self.poses[frames], self.places[marks]]))})

    def put(self, values: Values, frames: IntArray, marks: IntArray) -> None:
        """Some poses and targets to where `values` have them."""
        self.poses = _exchanged(self.poses, frames, values.poses_of(self.keys[frames], 3))
        self.places = _exchanged(self.places, marks, values.poses_of(self.looks.marks[marks], 3))

    def kept_if_less(self, rows: IntArray, *changes: Callable[[], None]) -> bool:
        """Whether some sightings cost less after some changes; where they do not, all is as it was."""
        before, cost = (self.poses, self.places), self._cost(rows)
        for change in changes:
            change()
        if self._cost(rows) < cost - LESS:
            return True
        self.poses, self.places = before
        return False

    def squared(self, rows: IntArray) -> Array:
        """Squared whitened residuals (k,) of some sightings."""
        looks = self.looks
        errors = looks.errors(rows, self.poses[looks.frame[rows]][None], self.places[looks.mark[rows]][None])
        return np.asarray(np.sum(errors[0] ** 2, -1))

    def _cost(self, rows: IntArray) -> float:
        return self.looks.cost(rows, self.squared(rows))

    def _votes(self, rows: IntArray, tried: Pose, *, from_frame: bool) -> Array:
        """Squared residuals (c,) of sightings (k,), each cut, were the pose (or target) each of those tried."""
        tried, looks = tried[:, None], self.looks
        ends = (
            (tried, self.places[looks.mark[rows]][None]) if from_frame else (self.poses[looks.frame[rows]][None], tried)
        )
        return np.asarray(np.minimum(np.sum(looks.errors(rows, *ends) ** 2, -1), CUT).sum(-1))

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


def some(rows: IntArray) -> IntArray:
    """Of many sightings some, spread evenly."""
    return np.asarray(rows[np.unique(np.linspace(0, len(rows) - 1, min(MOST, len(rows))).astype(int))])


def _exchanged(poses: Pose, places: int | IntArray, others: Pose) -> Pose:
    """The poses with other ones at some places."""
    rotation, translation = poses.rotation.copy(), poses.translation.copy()
    rotation[places], translation[places] = others.rotation, others.translation
    return Pose(rotation, translation)


def groups(of: IntArray, count: int) -> list[IntArray]:
    """The places of each number 0..count-1 in an array."""
    order = np.argsort(of, kind="stable")
    return np.split(order, np.searchsorted(of[order], np.arange(1, count)))


def _angles(turns: Array) -> Array:
    """By how much rotations (c, 3, 3) turn (c,) [rad]."""
    skew = turns - np.swapaxes(turns, -1, -2)  # 2 sin times the axis, each number twice
    sine = np.sqrt(0.125 * np.sum(skew * skew, (-2, -1)))
    return np.asarray(np.arctan2(sine, 0.5 * (np.trace(turns, axis1=-2, axis2=-1) - 1.0)))
