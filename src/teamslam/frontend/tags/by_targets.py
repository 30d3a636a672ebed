"""A start for a robot in space whose odometry says little: where it was, by the targets that it saw as poses.

    seed:    the pose that saw most targets is the frame
    spread:  forwards and backwards in time, a pose that sees a target that has a place gets its own, and gives the
             targets that it sees theirs, until nothing more is reached
    near:    after each, the latest poses and what they see are solved with all else held; a target whose sightings fit
             worse than their noise has it is chosen anew, and turned, and stays so if that costs less
    all:     after each of PARTS parts everything so far is solved: a loop closes by what was lost along it
    leap:    what no target leads to hangs on odometry: the next pose, and on from there
    turn:    at the end, targets whose sightings agree on another pose (`mirrored`)

A sighting may stand for two poses that fit alike (a small tag seen from the front): each is a candidate, and so is that
of every other sighting; the one counts that all sightings of the target (or from the pose) agree with best. Votes are
squared residuals cut at CUT, so a misread has one voice. One that is wrong turns all that comes after it, and where the
way closes, losses that forgive would keep it so: hence what is near is solved before the next pose hangs on it.

In space only: on the ground odometry keeps more. It costs WINDOW poses for each pose, and PARTS times a few steps of
least squares of half the rows on average, however long the way.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from teamslam.frontend.tags.looks import Looks
from teamslam.frontend.tags.mirrored import turned
from teamslam.frontend.tags.placed import Placed, groups, some
from teamslam.frontend.tags.whole_poses import CUT
from teamslam.geometry import Array, IntArray, Pose, concatenate
from teamslam.model import Kind, Table, Values, among
from teamslam.solver import settled

WINDOW = 10  # poses that are solved after each
PARTS = 20  # of the poses that saw something
DOUBT = 1.1  # of squared residuals for each number measured: from here on they fit worse than they should
MORE = 1.4  # times the sightings of a target when it was doubted last
TURNS = 4  # times that targets are turned, where turning some shows others


def by_targets(tables: Sequence[Table], way: Values, variances: Array) -> Values | None:
    """The robot's poses and the targets that it saw, in the frame of its first pose; None where it saw none as poses.

    `way` holds all its poses as odometry has them, `variances` (n - 1,) what each of its steps adds to a heading.
    """
    looks = Looks.of(tables, way)
    if not len(looks.frame):
        return None
    keys = way.layout.keys
    placed = Placed(looks, way, np.where(np.isfinite(variances), variances, np.pi**2))
    search = _Search(placed, [t.select(np.flatnonzero(among(t.keys, keys).all(1))) for t in tables])
    search.spread()
    search.solve_all()
    search.turn()
    poses, seen = placed.filled(), np.flatnonzero(placed.has_place)
    both = concatenate([poses, placed.places[seen]])
    return Values.of({Kind.POSE3: (np.concatenate([keys, looks.marks[seen]]), poses[:1].inverse() @ both)})


class _Search:
    """How what is `placed` grows."""

    def __init__(self, placed: Placed, odometry: Sequence[Table]) -> None:
        self.placed, self.odometry = placed, odometry
        self.ending = [groups(np.searchsorted(placed.keys, t.keys.max(1)), len(placed.keys)) for t in odometry]
        self.asked = np.zeros(len(placed.looks.marks), np.int64)  # the sightings of targets when they were doubted last

    def spread(self) -> None:
        """Until every pose that saw something has its place."""
        seeing = np.array([len(rows) > 0 for rows in self.placed.of_frame])
        count = np.array([len(np.unique(self.placed.looks.mark[rows])) for rows in self.placed.of_frame])
        part = -(-int(seeing.sum()) // PARTS)
        self.placed.put_frame(int(np.argmax(count)), Pose.identity(3, (1,)))
        while True:
            while self._sweep(np.flatnonzero(seeing), part) + self._sweep(np.flatnonzero(seeing)[::-1], part):
                pass
            open_ = np.flatnonzero(seeing & ~self.placed.has_pose)
            if not len(open_):
                return
            known = np.flatnonzero(self.placed.has_pose)
            gap = np.abs(open_[:, None] - known[None])
            nearest = np.unravel_index(np.argmin(gap), gap.shape)
            frame, before = int(open_[nearest[0]]), int(known[nearest[1]])
            step = 1 if frame > before else -1
            for one in range(before + step, frame + step, step):  # all of them, so that odometry ties what is beyond
                self.placed.put_frame(one, self.placed.reckoned_from(one, before))

    def _sweep(self, frames: IntArray, part: int) -> int:
        """How many poses found their places, of which everything was solved after each `part`."""
        done = 0
        for frame in frames.tolist():
            pose = None if self.placed.has_pose[frame] else self.placed.found(frame)
            if pose is None:
                continue
            self.placed.put_frame(frame, pose)
            self._solve_near()
            if len(self.placed.order) % part == 0:
                self.solve_all()
            done += 1
        return done

    def solve_all(self) -> None:
        """All that has a place nearer to the optimum of what ties it; the seed is held."""
        posed, placed = np.flatnonzero(self.placed.has_pose), np.flatnonzero(self.placed.has_place)
        seed = np.array(self.placed.order[:1])
        self._solve(np.setdiff1d(posed, seed), placed, seed, self.placed.looks.tables)

    def turn(self) -> None:
        """No target the wrong way round, where that costs less (see `mirrored`)."""
        every = np.arange(len(self.placed.looks.frame))
        for _ in range(TURNS):
            seen = np.flatnonzero(self.placed.has_place)
            other = turned(self.placed.values(np.flatnonzero(self.placed.has_pose), seen), self.placed.looks.tables)
            if other is None:
                break
            put = partial(self.placed.put, other, np.zeros(0, np.int64), seen)
            if not self.placed.kept_if_less(every, put, self.solve_all):
                break

    def _solve_near(self) -> None:
        """The latest poses and what they see nearer to the optimum of what ties them, all else held."""
        latest = np.array(self.placed.order[1:][-WINDOW:])
        rows = np.concatenate([self.placed.of_frame[frame] for frame in latest.tolist()])
        marks = np.unique(self.placed.looks.mark[rows])
        rows = np.concatenate([rows, *(self._elsewhere(mark, latest) for mark in marks.tolist())])
        beside = np.clip(np.concatenate([latest - 1, latest + 1]), 0, len(self.placed.keys) - 1)
        others = np.concatenate([self.placed.looks.frame[rows], beside[self.placed.has_pose[beside]]])
        near = latest, marks, np.setdiff1d(others, latest), self.placed.looks.only(rows)
        solve = partial(self._solve, *near)
        solve()
        for mark in self._doubtful(rows).tolist():
            for choose in (partial(self.placed.place_target, mark), partial(self.placed.turn_target, mark, latest)):
                self.placed.kept_if_less(rows, choose, solve)

    def _doubtful(self, rows: IntArray) -> IntArray:
        """Targets whose sightings fit worse than their noise has it, or one of which does not fit at all: each is asked
        for again when there are MORE times as many."""
        squared, numbers = self.placed.squared(rows), self.placed.looks.numbers[rows]
        marks, of = np.unique(self.placed.looks.mark[rows], return_inverse=True)
        worse = np.bincount(of, squared) > DOUBT * np.bincount(of, numbers)
        found = marks[worse | (np.bincount(of, squared > CUT) > 0)]
        found = found[self.placed.sightings[found] >= MORE * self.asked[found]]
        self.asked[found] = self.placed.sightings[found]
        return np.asarray(found)

    def _elsewhere(self, mark: int, latest: IntArray) -> IntArray:
        """Some sightings of a target from other poses that have a place."""
        rows = self.placed.of_mark[mark]
        frames = self.placed.looks.frame[rows]
        return some(rows[self.placed.has_pose[frames] & ~np.isin(frames, latest)])

    def _solve(self, frames: IntArray, marks: IntArray, held: IntArray, tables: Sequence[Table]) -> None:
        """Some poses and targets nearer to the optimum of sightings and odometry, with other poses held."""
        every = np.concatenate([frames, held])
        ways = [t.select(np.sort(np.concatenate([ends[frame] for frame in every.tolist()])))
                for t, ends in zip(self.odometry, self.ending, strict=True)]  # fmt: skip
        found = settled(self.placed.values(every, marks), [*tables, *ways], self.placed.keys[held])
        self.placed.put(found, frames, marks)
        for mark in marks.tolist():
            if self.placed.lost(mark):  # losses that forgive may let a target go anywhere
                self.placed.place_target(mark)
