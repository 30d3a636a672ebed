"""A robot is a value: what it heard so far, in pieces that are closed and rows that are open, and where it is now.

    step     rows in, the robot after them out; the pose of now with its covariance is there at once
    close    the pieces that have come to an end: what `teamslam.split` makes of the same rows, to the bit
    agree    poses where others saw it and it had none (`frontend.agreed`), in closed pieces as in those to come
    renew    the filter begins anew from a map in which earlier pieces lie (`outlook`), and goes through the open rows

Rows may come late, twice and out of order, up to `horizon_s` behind the newest; what comes later is dropped and
counted, unless it is held: a row that is told again is `repeated`, whenever that is. Within the horizon the order
changes nothing: pieces are a function of the set of rows, and the filter goes back to before a late row and through the
rest again. A piece is closed when nothing that may still come can change where it ends. A row that reaches back into a
closed piece (a loop closure) makes a new version of it.

A step costs what its rows and at most `landmarks` landmarks cost; after a late row, times the rows of the horizon. It
does not wait for closing, building and joining, which take a robot as it stands and may run beside it.
"""

from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.agreed import with_poses
from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.build.split import MIN_POSES, apart, cuts_along, refuse_borrowed
from teamslam.model import Dataset, Names, Table, index_of, pose_key
from teamslam.model.keys import MAX_INDEX
from teamslam.robot.changed import changed
from teamslam.robot.filter import Filter
from teamslam.robot.rows import ALWAYS, Batch, batches, divided, head_of, inserted, log_of, not_yet, poses_in, rank_of
from teamslam.robot.trail import Pace, Trail, along, begun_with, with_row

ROUNDING = 1e-9  # of sums in another order


@dataclass(frozen=True)
class Options:
    """How a robot maps while it drives.

    A submap closes after `poses_per_piece` poses, or where the dead-reckoned heading is uncertain by `heading_sigma`
    [rad]: the rules of `teamslam.split` (None: not by this rule; without either, at the end or where odometry is
    missing). `horizon_s` [s]: how far behind the newest row another may come. `landmarks`: how many are carried from
    step to step at most.
    """

    poses_per_piece: int | None = 100
    heading_sigma: float | None = None
    horizon_s: float = 0.0
    landmarks: int = 64

    def __post_init__(self) -> None:
        if self.poses_per_piece is not None and self.poses_per_piece < 2:
            raise InputError(f"a submap needs at least 2 poses, found {self.poses_per_piece}", field="poses_per_piece")
        if self.heading_sigma is not None and not 0.0 < self.heading_sigma < np.inf:
            raise InputError(f"an angle above 0 is needed, found {self.heading_sigma}", field="heading_sigma")
        if not 0.0 <= self.horizon_s < np.inf:
            raise InputError(f"a time of 0 s or more is needed, found {self.horizon_s}", field="horizon_s")
        if self.landmarks < 1:
            raise InputError(f"at least 1 landmark is needed, found {self.landmarks}", field="landmarks")


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where the robot is: its pose `key` in the frame of the pose `frame` (or WORLD), with the covariance in the chart
    of `geometry.pose`."""

    key: int
    frame: int
    pose: Pose
    covariance: Array


@dataclass(frozen=True)
class Counts:
    """Rows that were `taken`, came again (`repeated`) or too `late`."""

    taken: int = 0
    repeated: int = 0
    late: int = 0

    def with_more(self, taken: int = 0, repeated: int = 0, late: int = 0) -> "Counts":
        """These and more."""
        return Counts(self.taken + taken, self.repeated + repeated, self.late + late)


@dataclass(frozen=True, eq=False)
class Piece:
    """A closed stretch: its rows, up to the pose `end` at which the next begins (None: the last of the log). `version`
    counts how often something came after it was closed: rows, or poses by agreement."""

    number: int
    end: int | None
    rows: tuple[Batch, ...]
    version: int = 0


@dataclass(frozen=True, eq=False)
class Robot:
    """All that a robot knows of its own log.

    `head`: its channels (`rows`); `newest`: the tick of its newest row; `open`: batches that are in no closed piece, in
    order; `since`: the pose at which its log was cut last; `took`: what was new in the last step; `agreed`: poses of
    its own as others named them, rising, whether its odometry passes there or not; `twice`: the tick up to which a
    clock that went back has told its stamps twice, ALWAYS where none has.
    """

    number: int
    head: Dataset
    options: Options = field(default_factory=Options)
    open: tuple[Batch, ...] = ()
    since: int | None = None
    closed: tuple[Piece, ...] = ()
    newest: int = ALWAYS
    counts: Counts = field(default_factory=Counts)
    trail: Trail = ()
    took: tuple[Table, ...] = ()
    agreed: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    twice: int = ALWAYS

    @classmethod
    def of(cls, log: Dataset, number: int, options: Options | None = None) -> "Robot":
        """A robot that has heard nothing yet; of `log` only the channels count."""
        return cls(number, head_of(log, number), options or Options())

    @property
    def horizon(self) -> int:
        """In ticks."""
        return ceil(self.options.horizon_s / self.head.names.tick_s)

    @property
    def settled(self) -> int:
        """The tick before which no row will be taken any more."""
        return self.newest - self.horizon

    @property
    def now(self) -> Estimate | None:
        """Where it is; None before its first row."""
        filter_ = self.trail[-1].filter if self.trail else None
        if filter_ is None:
            return None
        return Estimate(filter_.key, filter_.frame, filter_.pose, filter_.pose_covariance)

    def calling(self, names: Names) -> "Robot":
        """With what everybody is called by now."""
        return self if names is self.head.names else replace(self, head=replace(self.head, names=names))

    def remembering(
        self, tables: Iterable[Table], versions: Mapping[int, int] | None = None, agreed: Iterable[int] = ()
    ) -> "Robot":
        """The robot after rows that it took once already, in any order, each once, and poses that it agreed on: its
        pieces, of which some have come to `versions` by their number, and its filter along the open rows, in a frame of
        its own until it is renewed. Law: its pieces are those of steps through the same rows."""
        known = tuple(sorted((b for table in tables for b in batches(self.head, table)), key=rank_of))
        newest = max((batch.time for batch in known), default=ALWAYS)
        counts = Counts(taken=sum(len(batch.table) for batch in known))
        robot = replace(self, open=known, newest=newest, counts=counts).close()
        closed = tuple(replace(p, version=(versions or {}).get(p.number, 0)) for p in robot.closed)
        trail, known_poses = along((), robot.open, robot._pace(newest)), np.unique(np.array(list(agreed), np.int64))
        return replace(robot, closed=closed, trail=trail, agreed=known_poses)

    # --- stepping -------------------------------------------------------------------------------------------------

    def step(self, tables: Iterable[Table]) -> "Robot":
        """The robot after some rows. Raises ModelError for rows that none of its channels brings, or that were taken
        from another robot's pose."""
        robot = changed(self, took=())
        for batch in sorted((b for table in tables for b in batches(self.head, table)), key=rank_of):
            refuse_borrowed(batch.table, self.head.names)
            robot = robot._take(batch)
        return robot

    def _take(self, batch: Batch) -> "Robot":
        if batch.time != ALWAYS and batch.time < self.settled:
            return self._pass_by(batch)
        if self.twice != ALWAYS != batch.time and index_of(batch.earliest) <= self.twice:  # of which time, nobody knows
            return replace(self, counts=self.counts.with_more(late=len(batch.table)))
        if self.since is not None and batch.earliest >= self.since:  # as nearly always: what is closed is not touched
            return self._go_on(batch)
        robot = self
        for number, part in divided(batch, [piece.end for piece in self.closed]):
            robot = robot._reopen(number, part) if number < len(self.closed) else robot._go_on(part)
        return robot

    def _pass_by(self, batch: Batch) -> "Robot":
        """With rows counted that came too late: `repeated` where they are held, whatever is told again."""
        counts, twice = self.counts, self.twice
        for number, part in divided(batch, [piece.end for piece in self.closed]):
            held = self.closed[number].rows if number < len(self.closed) else self.open
            lacked, again = not_yet(held, part)
            counts = counts.with_more(repeated=again, late=len(lacked.table))
            twice = self.newest if len(lacked.table) and self._contradicted(lacked) else twice
        return replace(self, counts=counts, twice=twice)

    def _contradicted(self, batch: Batch) -> bool:
        """Whether a batch that is late tells of a stretch of the way that was told of before, and otherwise: a clock
        that went back tells its stamps twice."""
        if not batch.moves:
            return False
        rows = next(
            (piece.rows for piece in self.closed if piece.rows and piece.rows[-1].time >= batch.time), self.open
        )
        here = (batch.time, False, batch.channel)
        first, stop = (bisect_left(rows, (*here, edge), key=rank_of) for edge in (-1, MAX_INDEX))
        known = [rows[n].table for n in range(first, stop)]
        return any(
            (table.keys[n] == batch.table.keys[0]).all() and not np.array_equal(table.values[n], batch.table.values[0])
            for table in known
            for n in range(len(table))
        )

    def _go_on(self, batch: Batch) -> "Robot":
        fresh, again = not_yet(self.open, batch)
        counts = self.counts.with_more(taken=len(fresh.table), repeated=again)
        if not len(fresh.table):
            return changed(self, counts=counts)
        rows, newest = inserted(self.open, fresh), max(self.newest, fresh.time)
        trail = with_row(self.trail, rows, fresh, self._pace(newest))
        return changed(self, open=rows, newest=newest, counts=counts, took=(*self.took, fresh.table), trail=trail)

    def _reopen(self, number: int, batch: Batch) -> "Robot":
        piece = self.closed[number]
        fresh, again = not_yet(piece.rows, batch)
        counts = self.counts.with_more(taken=len(fresh.table), repeated=again)
        if not len(fresh.table):
            return replace(self, counts=counts)
        newer = replace(piece, rows=inserted(piece.rows, fresh), version=piece.version + 1)
        closed = (*self.closed[:number], newer, *self.closed[number + 1 :])
        return replace(self, closed=closed, counts=counts, took=(*self.took, fresh.table))

    def _pace(self, newest: int) -> Pace:
        horizon = self.horizon
        return Pace(self.head.robots[self.number], self.options.landmarks, newest - horizon, horizon)

    # --- closing --------------------------------------------------------------------------------------------------

    @property
    def due(self) -> bool:
        """Whether it may be worth while to look for a piece that has come to an end (`close`)."""
        most, sigma = self.options.poses_per_piece, self.options.heading_sigma
        least = min((n for n in (most, MIN_POSES if sigma is not None else None) if n is not None), default=None)
        if least is None or len(self.open) < least:
            return False
        past = self.open[: bisect_left(self.open, (self.settled, False, -1, -1), key=rank_of)]
        moves = sum([batch.moves for batch in past])
        if most is not None and moves >= most:
            return True
        lost = sum([batch.heading_variance for batch in past]) if sigma is not None and moves >= MIN_POSES else 0.0
        return sigma is not None and lost * (1.0 + ROUNDING) > sigma**2

    def close(self) -> "Robot":
        """With every piece closed that has come to an end."""
        ends = self._cuts(int(pose_key(self.number, max(self.settled, 0))))
        return self._closed_at(ends.tolist()) if len(ends) else self

    def finish(self) -> "Robot":
        """With all closed: no row will come any more. Law: `pieces` are those of `teamslam.split`."""
        return replace(self._closed_at([*self._cuts(None).tolist(), None]), since=None) if self.open else self

    def pieces(self, number: int) -> list[Dataset]:
        """The pieces of log of a closed stretch: one, or several where odometry is missing within it."""
        return apart(with_poses(log_of(self.head, self.closed[number].rows), self.number, self.agreed), self.number)

    def agreeing(self, keys: IntArray) -> "Robot":
        """With poses at times at which others saw it (its own keys). A closed piece whose odometry passes there comes
        again in a new version. Law: the order and repetition of keys change no piece."""
        fresh = np.setdiff1d(keys, self.agreed)
        if not len(fresh):
            return self
        closed = tuple(
            replace(piece, version=piece.version + 1) if self._passes(piece, fresh) else piece for piece in self.closed
        )
        return replace(self, agreed=np.union1d(self.agreed, fresh), closed=closed)

    def _passes(self, piece: Piece, keys: IntArray) -> bool:
        """Whether some poses by agreement are new in a piece."""
        rows = with_poses(log_of(self.head, piece.rows), self.number, self.agreed)
        return with_poses(rows, self.number, keys) is not rows

    def _cuts(self, until: int | None) -> IntArray:
        poses = poses_in(self.open, self.number)
        if self.since is not None:
            poses = np.union1d(poses[poses >= self.since], [self.since])
        odometry = log_of(self.head, (batch for batch in self.open if batch.moves))
        return cuts_along(
            poses, odometry, self.number, until=until,
            poses_per_piece=self.options.poses_per_piece, heading_sigma=self.options.heading_sigma,
        )  # fmt: skip

    def _closed_at(self, ends: Sequence[int | None]) -> "Robot":
        parts: list[list[Batch]] = [[] for _ in range(len(ends) + 1)]
        for batch in self.open:
            for number, part in divided(batch, ends):
                parts[number].append(part)
        first = len(self.closed)
        closed = tuple(Piece(first + n, end, tuple(parts[n])) for n, end in enumerate(ends))
        return replace(self, closed=(*self.closed, *closed), open=tuple(parts[-1]), since=ends[-1])

    # --- beginning anew -------------------------------------------------------------------------------------------

    def renew(self, start: Filter) -> "Robot":
        """With a filter that begins at one of its poses, in which all rows before that pose are, and goes through the
        rows since."""
        later = [piece.rows for piece in self.closed if piece.end is None or piece.end > start.key]
        rows = [
            part for batch in (*(b for rows in later for b in rows), *self.open)
            for number, part in divided(batch, [start.key]) if number
        ]  # fmt: skip
        return replace(self, trail=along((begun_with(start),), sorted(rows, key=rank_of), self._pace(self.newest)))
