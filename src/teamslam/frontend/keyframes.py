"""Where robots get poses: at the stamps of odometry, and wherever something was seen in between.

A sighting seldom has the stamp of an odometry row. In mode 'interpolate' it gets a pose of its own there:

- increments (from_stamp, to_stamp) are split: z = Z(f) @ rest, Z(f) = 1 (+) f (z (-) 1), and the covariance is shared
  out in proportion to time. That is a simplification: it takes the motion within one increment as even, and it leaves
  out that a turn early in the increment swings the rest of the way. Parts compose to the whole again.
- streams (absolute odometry poses, velocities) are differenced or integrated between the wanted stamps, with a keyframe
  every so often besides.

Stamps nearer than a tolerance are one. A sighting where a robot has no odometry, before its first row or in a hole, is
left out and counted; a robot without any odometry has poses just where it is seen or sees.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.stamps import keyframe_of, merge
from teamslam.frontend.velocity import VelocityNoise, integrate
from teamslam.geometry import Array, BoolArray, IntArray, Pose
from teamslam.model import (
    Dropped,
    Loss,
    Names,
    Table,
    index_of,
    is_pose,
    pack,
    pose_key,
    robot_of,
    whitening,
)
from teamslam.model.sensors import pose_of

UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}  # in a second
ALIKE = 1.5  # times as long as the odometry, at most, sightings of the same drive go on


@dataclass(frozen=True, eq=False)
class Stream:
    """Odometry of one robot at rising ticks (n,): absolute `poses` with `rate_whitening` (whitening after one second),
    or `velocities` (n, 2) with `noise`. `every` ticks at most between keyframes."""

    robot: int
    source: str
    ticks: IntArray
    every: int
    loss: Loss
    poses: Pose | None = None
    rate_whitening: Array | None = None
    velocities: Array | None = None
    noise: VelocityNoise | None = None


def is_increment(table: Table) -> bool:
    """True for odometry given as increments between a robot's own poses."""
    if not table.is_odometry:
        return False
    return bool((is_pose(table.keys) & (robot_of(table.keys) == table.robot)).all())


def place_keyframes(
    tables: Sequence[Table], streams: Sequence[Stream], *, tolerance: int, names: Names
) -> tuple[list[Table], list[Dropped]]:
    """The tables with every sighting at a keyframe, odometry between neighbouring keyframes, and what was left out."""
    increments = [table for table in tables if is_increment(table)]
    wanted = _poses_of(table for table in tables if not is_increment(table))
    of_robot = robot_of(wanted)
    ways: dict[int, _Way] = {}
    for robot in sorted({*of_robot.tolist(), *(t.robot for t in increments), *(s.robot for s in streams)}):
        way = _Way.of(
            robot, [t for t in increments if t.robot == robot], [s for s in streams if s.robot == robot], names
        )
        ways[robot] = way.with_keyframes(index_of(wanted[of_robot == robot]), tolerance)
    placed = [table if is_increment(table) else _at_keyframes(table, ways) for table in tables]
    dropped = [
        Dropped(lost, f"robot {names.robot(table.robot)}: {table.source} where a robot has no odometry{other}")
        for table, left in zip(tables, placed, strict=True)
        if (lost := len(table) - len(left))
        for other in [_another_clock(table, ways, names) if 2 * lost > len(table) else ""]
    ]
    # Keyframes that only lost sightings wanted are not among these.
    used = _poses_of(table for table in placed if not is_increment(table))
    cut = [
        _split(table, index_of(used[robot_of(used) == table.robot])) if is_increment(table) else table
        for table in placed
    ]
    return cut + [_between(s, index_of(used[robot_of(used) == s.robot]), names) for s in streams], dropped


def _another_clock(table: Table, ways: dict[int, "_Way"], names: Names) -> str:
    """What the stamps of sightings beside those of their robot's odometry look like, where another clock explains why
    most of them lie where there is none."""
    way, ticks = ways[table.robot], index_of(table.keys[robot_of(table.keys) == table.robot])
    if names.counts or not len(ticks) or not len(way.start):
        return ""
    (a, b), (c, d) = ((float(t[0]), float(t[1])) for t in ((ticks.min(), ticks.max()), (way.start[0], way.stop.max())))
    spans = (
        f"; they are stamped {a * names.tick_s:.3f} to {b * names.tick_s:.3f} s, the odometry {c * names.tick_s:.3f} "
        f"to {d * names.tick_s:.3f} s"
    )
    for times, unit in UNITS.items():
        if 0.5 * (d - c) < (b - a) / times < ALIKE * (d - c) and a / times < d and b / times > c:
            return f"{spans}: their stamps look like {unit}, and seconds are expected"
    if (a > d or b < c) and b - a < ALIKE * (d - c):
        return f"{spans}: do both clocks count from one zero?"
    return ""


def _poses_of(tables: Iterable[Table]) -> IntArray:
    """The keys of all poses that tables name, rising."""
    keys = [table.keys[is_pose(table.keys)] for table in tables]
    return np.unique(np.concatenate(keys)) if keys else np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class _Way:
    """When a robot has odometry: intervals (n,) that do not overlap, and stamps that are keyframes anyway."""

    start: IntArray
    stop: IntArray
    anchors: IntArray
    free: bool  # no odometry at all: any stamp will do
    wanted: IntArray
    keyframe: IntArray  # of each wanted stamp; -1 where there is no odometry

    @classmethod
    def of(cls, robot: int, increments: Sequence[Table], streams: Sequence[Stream], names: Names) -> "_Way":
        none = np.zeros(0, np.int64)
        if len(streams) + (1 if increments else 0) > 1:
            raise InputError(
                f"robot {names.robot(robot)} has several logs of odometry that differ in kind; "
                f"give one of poses, one of velocities, or increments"
            )
        if streams:
            ticks = streams[0].ticks
            return cls(ticks[:1], ticks[-1:], none, False, none, none)
        ends = index_of(np.concatenate([t.keys for t in increments])) if increments else np.zeros((0, 2), np.int64)
        ends = ends[np.argsort(ends[:, 0], kind="stable")]
        late = np.flatnonzero(ends[1:, 0] < ends[:-1, 1])
        if len(late):
            first, second = (ends[late[0] + k] * names.tick_s for k in (0, 1))
            raise InputError(
                f"robot {names.robot(robot)} has two increments of odometry that overlap: {first[0]:.6f} to "
                f"{first[1]:.6f} s and {second[0]:.6f} to {second[1]:.6f} s; each moment belongs to one row"
            )
        return cls(ends[:, 0], ends[:, 1], np.unique(ends), not len(ends), none, none)

    def with_keyframes(self, wanted: IntArray, tolerance: int) -> "_Way":
        """Each wanted stamp at the nearest anchor within the tolerance, else in a group of its own kind."""
        keyframe = np.full(len(wanted), -1, np.int64)
        if len(self.anchors):
            right = np.minimum(np.searchsorted(self.anchors, wanted), len(self.anchors) - 1)
            left = np.maximum(right - 1, 0)
            nearest = np.where(np.abs(self.anchors[left] - wanted) <= np.abs(self.anchors[right] - wanted), left, right)
            near = np.abs(self.anchors[nearest] - wanted) <= tolerance
            keyframe[near] = self.anchors[nearest[near]]
        rest = np.flatnonzero((keyframe < 0) & self._covers(wanted))
        keyframe[rest] = keyframe_of(merge(wanted[rest], tolerance), wanted[rest])
        return replace(self, wanted=wanted, keyframe=keyframe)

    def _covers(self, ticks: IntArray) -> BoolArray:
        if self.free:
            return np.ones(len(ticks), bool)
        at = np.searchsorted(self.start, ticks, "right") - 1
        return np.asarray((at >= 0) & (ticks <= self.stop[at]))


def _at_keyframes(table: Table, ways: dict[int, _Way]) -> Table:
    """A table of sightings with its poses at keyframes, without the rows that have none."""
    keys = table.keys.copy()
    good = np.ones(len(keys), bool)
    for robot, way in ways.items():
        mask = robot_of(keys) == robot
        ticks = way.keyframe[np.searchsorted(way.wanted, index_of(keys[mask]))]
        good &= ~(mask & ~_spread(mask, ticks >= 0)).any(-1)
        keys[mask] = pose_key(robot, np.maximum(ticks, 0))
    return replace(table, keys=keys).select(good)


def _spread(mask: BoolArray, found: BoolArray) -> BoolArray:
    out = np.zeros(mask.shape, bool)
    out[mask] = found
    return out


def _split(table: Table, keyframes: IntArray) -> Table:
    """Increments cut at the keyframes within them; rows are numbered anew where one was cut."""
    cut = cut_at(table, keyframes)
    return cut if cut is table else replace(cut, ids=np.arange(len(cut)))


def cut_at(table: Table, keyframes: IntArray) -> Table:
    """Increments that do not overlap, cut at the keyframes (m,) [ticks, rising] within them, in order of time; parts
    keep the number of their row. The table itself where there is nothing to cut."""
    start, stop = index_of(table.keys).T
    row_of = np.argsort(start, kind="stable")
    start, stop = start[row_of], stop[row_of]
    at = np.searchsorted(start, keyframes, "right") - 1
    inner = keyframes[(at >= 0) & (keyframes > start[at]) & (keyframes < stop[at])] if len(start) else keyframes[:0]
    if not len(inner):
        return table
    begins = np.sort(np.concatenate([start, inner]))
    of_row = np.searchsorted(start, begins, "right") - 1
    last = np.append(of_row[1:] != of_row[:-1], True)
    ends = np.where(last, stop[of_row], np.append(begins[1:], 0))
    length = (stop - start)[of_row]
    rows = row_of[of_row]
    z = pose_of(table.values, table.dim)[rows]
    parts = _fraction(z, (begins - start[of_row]) / length).between(_fraction(z, (ends - start[of_row]) / length))
    share = (ends - begins) / length
    W = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:]))
    return replace(
        table,
        keys=pose_key(table.robot, np.stack([begins, ends], -1)),
        values=pack(parts),
        whitening=W[rows] / np.sqrt(share)[:, None, None],
        ids=table.ids[rows],
    )


def _fraction(z: Pose, f: Array) -> Pose:
    one = Pose.identity(z.dim, z.batch)
    return one.retract(f[:, None] * z.minus(one))


def _between(stream: Stream, wanted: IntArray, names: Names) -> Table:
    """A stream as increments between its keyframes."""
    at = _filled(np.unique(np.concatenate([stream.ticks[[0, -1]], wanted])), stream.every)
    if stream.velocities is not None and stream.noise is not None:
        increments, covariances = integrate(stream.ticks, stream.velocities, at, stream.noise, tick_s=names.tick_s)
        steps, W = Pose.from_xytheta(increments), whitening(covariances)
    else:
        assert stream.poses is not None and stream.rate_whitening is not None
        poses, _ = interpolate(stream.ticks, stream.poses, at, int(at[-1] - at[0]))
        before = np.arange(len(at) - 1)
        steps = poses[before].between(poses[before + 1])
        W = stream.rate_whitening / np.sqrt(np.diff(at) * names.tick_s)[:, None, None]
    keys = pose_key(stream.robot, at)
    return Table(
        stream.robot, stream.source, "relative_pose", steps.dim, np.stack([keys[:-1], keys[1:]], -1), pack(steps), W,
        np.arange(len(at) - 1), loss=stream.loss,
    )  # fmt: skip


def _filled(keyframes: IntArray, every: int) -> IntArray:
    """Keyframes with more between those that are further apart than `every`, evenly."""
    gaps = np.diff(keyframes)
    parts = np.maximum(-(-gaps // every), 1)
    first = np.repeat(keyframes[:-1], parts)
    step = np.arange(len(first)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(first + np.repeat(gaps, parts) * step // np.repeat(parts, parts), keyframes[-1])


def without_repeats(table: Table) -> Table:
    """The table without rows that repeat an earlier one in every number."""
    rows = np.concatenate([table.keys, np.ascontiguousarray(table.values).view(np.int64)], -1)
    _, first = np.unique(rows, axis=0, return_index=True)
    return table if len(first) == len(rows) else table.select(np.sort(first))
