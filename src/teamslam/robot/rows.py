"""Rows as they arrive: known by the channel they come from, put in order of time, and put together again as a log.

A channel is a table without rows: who measures what with which sensor, noise and loss. What a robot has is its `head`,
a Dataset of such tables in the order in which its log has them. Arriving rows are small tables; a batch is those of one
channel that were taken at one time.

    time of a row   the stamp of its pose; between two of the robot's own poses, of the later: when it was measured
    order           by time, odometry first, then channel and number
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import Array, IntArray
from teamslam.joining.build.split import taken_from
from teamslam.model import Dataset, Table, index_of, is_pose, pack, robot_of, variances
from teamslam.model.keys import MAX_INDEX

ALWAYS = -1  # the time of what was measured from no pose: a landmark that was surveyed
Rank = tuple[int, bool, int, int]


@dataclass(frozen=True, eq=False)
class Batch:
    """Rows of one channel of one time; `moves`: they are relative poses between two of the robot's own poses."""

    time: int
    moves: bool
    channel: int
    table: Table

    @cached_property
    def taken(self) -> tuple[int, int]:
        """The first and the last pose that its rows were taken from (`taken_from`)."""
        at = [min(keys) if self.moves else keys[0] for keys in self.table.keys.tolist()]
        first, last = min(at), max(at)
        return first if first > MAX_INDEX else ALWAYS, last if last > MAX_INDEX else ALWAYS

    @property
    def earliest(self) -> int:
        """The first of them."""
        return self.taken[0]

    @cached_property
    def heading_variance(self) -> float:
        """How much less the heading is known after its steps, at most [rad^2]."""
        if not self.moves or self.table.model != "relative_pose":
            return 0.0
        each = variances(self.table.whitening)[:, self.table.dim :].sum(-1)
        return float(np.broadcast_to(each, len(self.table)).sum(where=np.isfinite(each)))

    @cached_property
    def rank(self) -> Rank:
        """Its place in the order."""
        return (self.time, not self.moves, self.channel, int(self.table.ids[0]))


def rank_of(batch: Batch) -> Rank:
    """Its place in the order."""
    return batch.rank


def head_of(log: Dataset, robot: int) -> Dataset:
    """The channels of one robot's log: its tables without their rows, the team and its names."""
    tables = (table.select(np.zeros(0, np.int64)) for table in log.tables if table.robot == robot)
    return Dataset(log.robots, tuple(tables), log.names)


def batches(head: Dataset, table: Table) -> list[Batch]:
    """A table that arrived, by time; none where it has no rows. Raises ModelError where no channel of the robot brings
    such rows."""
    channel = channel_of(head, table)
    if not len(table):
        return []
    own = table.own
    moves = np.asarray(own.all(1) & (not table.row.unary))
    stamps = np.where(own, index_of(table.keys), ALWAYS).max(1)
    if (stamps == stamps[0]).all() and (moves == moves[0]).all():
        return [Batch(int(stamps[0]), bool(moves[0]), channel, table)]
    group = 2 * stamps + ~moves
    order = np.argsort(group, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    return [Batch(int(stamps[p[0]]), bool(moves[p[0]]), channel, table.select(p)) for p in parts]


def log_of(head: Dataset, held: Iterable[Batch]) -> Dataset:
    """The log that batches make: each channel's rows in the order of their numbers, as the robot's log has them."""
    by_channel: dict[int, list[Table]] = {}
    for batch in held:
        by_channel.setdefault(batch.channel, []).append(batch.table)
    return head.with_tables(_together(head.tables[n], by_channel[n]) for n in sorted(by_channel))


def poses_in(held: Iterable[Batch], robot: int) -> IntArray:
    """A robot's own poses in batches, rising."""
    keys = np.concatenate([np.zeros(0, np.int64), *(batch.table.keys.ravel() for batch in held)])
    return np.unique(keys[is_pose(keys) & (robot_of(keys) == robot)])


def divided(batch: Batch, ends: Sequence[int | None]) -> list[tuple[int, Batch]]:
    """A batch in parts, by the number of poses of `ends` (rising; None: the end of all) that come no later than those
    its rows were taken from."""
    cuts = [end for end in ends if end is not None]
    first, last = (bisect_right(cuts, pose) for pose in batch.taken)
    if first == last:
        return [(first, batch)]
    part = np.searchsorted(cuts, taken_from(batch.table), side="right")
    return [(n, replace(batch, table=batch.table.select(part == n))) for n in np.unique(part).tolist()]


def inserted(held: tuple[Batch, ...], batch: Batch) -> tuple[Batch, ...]:
    """Batches in order with one more."""
    if not held or held[-1].rank < batch.rank:
        return (*held, batch)
    at = bisect_right(held, batch.rank, key=rank_of)
    return (*held[:at], batch, *held[at:])


def not_yet(held: Sequence[Batch], batch: Batch) -> tuple[Batch, int]:
    """A batch without the rows that are there already, and how many these are."""
    here = (batch.time, not batch.moves, batch.channel)
    if not held or held[-1].rank < here:
        return batch, 0
    first, stop = (bisect_left(held, (*here, edge), key=rank_of) for edge in (-1, MAX_INDEX))
    known = [held[n].table.ids for n in range(first, stop)]
    again = np.isin(batch.table.ids, np.concatenate(known)) if known else np.zeros(len(batch.table), bool)
    if not again.any():
        return batch, 0
    return replace(batch, table=batch.table.select(~again)), int(again.sum())


def _together(channel: Table, parts: Sequence[Table]) -> Table:
    ids = np.concatenate([part.ids for part in parts])
    order = np.argsort(ids, kind="stable")
    shared = len(channel.whitening) == 1
    return replace(
        channel,
        keys=np.concatenate([part.keys for part in parts])[order],
        values=np.concatenate([part.values for part in parts])[order],
        whitening=channel.whitening if shared else np.concatenate([_each(part) for part in parts])[order],
        ids=ids[order],
    )


def _each(table: Table) -> Array:
    return np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))


def channel_of(head: Dataset, table: Table) -> int:
    """Which channel brings a table's rows. Raises ModelError where none does."""
    for number, channel in enumerate(head.tables):
        if _brings(channel, table):
            return number
    known = ", ".join(f"{t.source} ({t.model}, {t.dim}D)" for t in head.tables)
    raise ModelError(
        f"robot {head.names.robot(table.robot)} has no channel for {table.source} ({table.model}, {table.dim}D) with "
        f"this sensor, noise and loss; it has: {known}"
    )


def _brings(channel: Table, table: Table) -> bool:
    """Whether a table's rows come from a channel."""
    same = (channel.robot, channel.source, channel.model, channel.dim, channel.loss)
    if same != (table.robot, table.source, table.model, table.dim, table.loss):
        return False
    if channel.sensor is not table.sensor and not _same_mount(channel, table):
        return False
    if len(channel.whitening) != 1 or channel.whitening is table.whitening:
        return True
    return len(table.whitening) == 1 and np.array_equal(channel.whitening, table.whitening)


def _same_mount(channel: Table, table: Table) -> bool:
    if channel.sensor is None or table.sensor is None:
        return False
    return channel.sensor.dim == table.sensor.dim and np.array_equal(pack(channel.sensor), pack(table.sensor))
