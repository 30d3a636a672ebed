"""What two looks at one landmark say of mistakes in a robot's log, before anything is solved.

All triangles of two looks and the odometry between them (see `pairs`) are taken from a few stretches of the robot's
way, so that what they cost does not grow with the log. A mistake changes values and no keys: the triangles are found
once, and closed again for every mistake. How likely the looks are as they are written, and how likely as they would be
meant, is the evidence:

    gain  =  -2 log p(looks | as written)  +  2 log p(looks | as meant)  +  2 n log f

for n numbers that were written in another unit f. A triangle that is far off counts as far off and no more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, IntArray
from teamslam.joining import split
from teamslam.model import Dataset, Table, is_landmark, is_pose, robot_of
from teamslam.trust.causes.pairs import FAR, Closing, Pairs, Way, closing, pairs_of, way_of

POSES = 80  # of a stretch
STRETCHES = 8  # those with most looks
FEWEST = 20  # triangles of a stretch, and of a robot


@dataclass(frozen=True, eq=False)
class Looks:
    """Some stretches of a robot's own log as one with gaps, and the triangles in them, by table."""

    log: Dataset
    robot: int
    way: Way
    pairs: tuple[Pairs, ...]

    @classmethod
    def of(cls, log: Dataset, robot: int) -> "Looks | None":
        """Those of a robot; None where it has no odometry, or hardly anything was seen twice."""
        piece = _busy(own(log, robot), robot)
        try:
            way = way_of(piece, robot)
        except TeamslamError:
            return None
        pairs = tuple(pairs_of(piece, robot, table, way.runs) for table in piece.tables)
        return cls(piece, robot, way, pairs) if sum(map(len, pairs)) >= FEWEST else None

    @cached_property
    def as_written(self) -> list[Closing]:
        """How the triangles close, by table."""
        return self._closings(self.log.tables, self.way)

    def meant(self, log: Dataset) -> list[Closing]:
        """How they close in another reading of the same rows."""
        both = zip(log.tables, self.log.tables, strict=True)
        same = all(new is old for new, old in both if old.model == "relative_pose")
        return self._closings(log.tables, self.way if same else way_of(log, self.robot))

    def by(self, way: Way) -> list[Closing]:
        """How they close if the robot went another way."""
        return self._closings(self.log.tables, way)

    def gain(self, closings: Sequence[Closing]) -> float:
        """By how much likelier the looks are with other closings, without what other units change."""
        return unlikely(self.as_written) - unlikely(closings)

    def worst(self) -> Dataset | None:
        """The stretch where triangles close worst, all of it linked; None where none has triangles enough."""
        chain = self.log.pose_keys[self.robot]
        count = max(len(chain) // POSES, 1)
        where = np.concatenate([p.after * count // len(chain) for p in self.pairs])
        off = np.minimum(np.concatenate([c.off for c in self.as_written]), FAR)
        looks = np.bincount(where, minlength=count)
        mean = np.bincount(where, off, count) / np.maximum(looks, 1)
        stretch = int(np.argmax(np.where(looks >= FEWEST, mean, -1.0)))
        held = [t.select(_stretch(t.keys, chain, count) == stretch) for t in self.log.tables]
        pieces = split(self.log.with_tables(t for t in held if len(t)), poses_per_piece=POSES)
        return max(pieces, key=lambda piece: sum(map(len, piece.tables)), default=None)

    def _closings(self, tables: Sequence[Table], way: Way) -> list[Closing]:
        return [closing(table, pairs, way) for table, pairs in zip(tables, self.pairs, strict=True)]


def unlikely(closings: Sequence[Closing]) -> float:
    """-2 log of how likely the looks are."""
    return float(sum(c.unlikely.sum() for c in closings))


def off(closings: Sequence[Closing]) -> float:
    """How far triangles are off on average: squared, in variances, far ones as far."""
    found: Array = np.concatenate([np.zeros(0), *(c.off for c in closings)])
    return float(np.minimum(found, FAR).mean()) if len(found) else 0.0


def own(log: Dataset, robot: int) -> Dataset:
    """What a robot measured without the others: its odometry, and landmarks."""
    tables = [table for table in log.tables if table.robot == robot and not table.row.unary]
    mine = [((robot_of(t.keys) == robot) | is_landmark(t.keys)).all(1) for t in tables]
    kept = [table.select(rows) for table, rows in zip(tables, mine, strict=True)]
    return log.with_tables(table for table in kept if len(table))


def _busy(log: Dataset, robot: int) -> Dataset:
    """The stretches of a robot's way from which most was seen, as one log with gaps."""
    chain = log.pose_keys.get(robot, np.zeros(0, np.int64))
    count = len(chain) // POSES
    if count <= STRETCHES:
        return log
    places = [_stretch(table.keys, chain, count) for table in log.tables]
    looks = np.zeros(count, np.int64)
    for table, place in zip(log.tables, places, strict=True):
        looks += np.bincount(place[(place >= 0) & is_landmark(table.keys[:, -1])], minlength=count)
    busy = np.argsort(-looks, kind="stable")[:STRETCHES]
    return log.with_tables(t.select(np.isin(p, busy)) for t, p in zip(log.tables, places, strict=True))


def _stretch(keys: IntArray, chain: IntArray, count: int) -> IntArray:
    """In which of so many stretches of a chain each row lies (m,), -1 where its poses lie in two."""
    place = np.minimum(np.searchsorted(chain, keys) * count // max(len(chain), 1), count - 1)
    poses = is_pose(keys)
    first, last = np.where(poses, place, count).min(1), np.where(poses, place, -1).max(1)
    return np.asarray(np.where(first == last, first, -1))
