"""Sensors that turn on their robots while these drive: a gimbal that nobody logged, a camera that was knocked.

A map follows them: what all that is seen at once is off by looks like a turn of the robot, odometry seems to be worse
than it says, and once that is put right the map fits, with headings that are wrong. So where a map costs too much, how
each sensor is turned at some moments, between which it turns evenly, is taken for unknown beside the map: once to first
order, for each sensor by itself. Told is the one by which nearly all of the excess goes, most of it for that it moves,
and by which it is gone once the log is solved with it. The whole log is then mapped with these turns as unknowns, and
what stays uncertain of them is in the covariances of its map.

Moments are EACH images apart, so that odometry that is worse than it says, which turns a robot anew with each image, is
no sensor that moves.

Bound: logs of up to ROWS rows; an elimination of the map for each sensor, and where one is told TRIED more, and a solve
in a few rounds.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from teamslam.geometry import Array, IntArray, directions, rotations
from teamslam.joining import AtMap, cost_of
from teamslam.model import Dataset, Stamps, Standing, Table, Unknown, Values
from teamslam.solver import Options
from teamslam.trust.cause import Cause, rows_called
from teamslam.trust.mounts import MOST, SUSPECT, TURN, Sensor
from teamslam.trust.unknowns import settled
from teamslam.trust.unknowns.effects import Effects
from teamslam.trust.unknowns.normal import beside_prior, eliminated

MODELS = ("bearing", "range_bearing", "point")
ROWS = 50_000
EACH, MOMENTS = 5, (4, 24)  # images between moments; at least, and at most
KNOCK, TRIED = 2, 16  # moments of a sensor that turned once; images that are tried for it
EXPLAINED, MOVING = 0.7, 0.25  # of the excess: by a sensor that moves, and what one that is askew throughout would not
STEP, SMALL = 0.2, 1e-4  # [rad]
QUICK = Options(max_iterations=50, decrement=0.01)


def turning(log: Dataset, at: Sequence[AtMap]) -> list[Cause]:
    """The sensor that turns on its robot, in words, with what makes its turns unknown; none of a log that rests on
    other things that are unknown, that is no one map, or which fits. `at` is the log at its map. Raises SolveError
    where its rows do not determine that."""
    sensors = [] if log.unknowns is not None or len(at) != 1 else list(_sensors(log))
    if not 0 < len(sensors) <= MOST or len(at[0]) > ROWS:
        return []
    gap, due = at[0].gap, float(sum(table.dof for table in at[0].tables) - at[0].gap.free.dof)
    excess = gap.cost - gap.decrease - due
    if due < 1.0 or excess < (SUSPECT - 1.0) * due:
        return []
    tried = [_Look.at(Turns.of(log, sensor, _moments(log, sensor)), at[0]) for sensor in sensors]
    best = max(tried, key=lambda look: look.gain)
    if best.gain < EXPLAINED * excess or best.moving < MOVING * excess:
        return []
    best = max([best, *(_Look.at(turned, at[0]) for turned in _knocked(log, best))], key=lambda look: look.gain)
    found = settled(best.turned, QUICK)
    if found is None or found.why or found.joined is None or len(found.joined.components) != 1:
        return []
    left = cost_of(found.joined.map, found.log.tables).cost
    if gap.cost - left < EXPLAINED * excess:
        return []
    sensor, moments = best.turns.sensor, best.turns.moments
    robot, (source, _, _) = sensor
    most = np.degrees(max(abs(each.value) for each in found.found))
    when = f"at {moments[0]:.1f} s" if len(moments) == KNOCK else "while that drove"
    said = (
        f"robot {log.names.robot(robot)}, {rows_called(source)}: its sensor turned on the robot {when}, it was up to "
        f"{most:.2g} degrees from where it is stated; what costs {gap.cost:,.0f} costs {left:,.0f} where that is "
        f"estimated ({due:,.0f} expected)"
    )
    share = float(np.clip((gap.cost - left) / excess, 0.0, 1.0))
    return [Cause("turning", said, share, (robot,), partial(Turns.of, sensor=sensor, moments=moments))]


@dataclass(frozen=True, eq=False)
class _Look:
    """A log with a sensor that may turn, and what a map's rows say of its turns to first order: their information
    `own` (k, k) beside the map, and the `slope` (k,) of the cost that they would lower."""

    turned: Dataset
    own: Array
    slope: Array

    @classmethod
    def at(cls, turned: Dataset, at: AtMap) -> "_Look":
        """By the rows of a map."""
        assert isinstance(turned.unknowns, Turns)
        effects = Effects(turned.unknowns, [at])
        return cls(turned, *eliminated(at, lambda table: effects.at(at, table)))

    @property
    def turns(self) -> "Turns":
        """How it may turn."""
        assert isinstance(self.turned.unknowns, Turns)
        return self.turned.unknowns

    @property
    def values(self) -> Array:
        """The turns that lower the cost most (k,)."""
        return _lowest(self.own, self.slope)

    @property
    def gain(self) -> float:
        """What the map's cost loses by them, beyond what chance would."""
        return float(self.slope @ self.values) - len(self.slope)

    @property
    def moving(self) -> float:
        """How much of that it would not lose by one turn for all of the log."""
        angles = _angles(self.turns.sensor)
        as_one = np.tile(np.eye(angles), (len(self.slope) // angles, 1))
        pull = as_one.T @ self.slope
        return self.gain - float(pull @ _lowest(as_one.T @ self.own @ as_one, pull))


def _lowest(own: Array, slope: Array) -> Array:
    """The turns (k,) of a lowest cost, each with its prior."""
    return np.asarray(beside_prior(own + np.eye(len(slope)) / TURN**2, np.full(len(slope), TURN)) @ slope)


def _knocked(log: Dataset, best: _Look) -> Iterator[Dataset]:
    """The log with a sensor that turned once, between two images, near where it turns most."""
    moments, there = best.turns.moments, best.values.reshape(len(best.turns.moments), -1)
    most = int(np.argmax(np.linalg.norm(np.diff(there, axis=0), axis=1)))
    stamps = _images(log, best.turns.sensor)
    near = stamps[(stamps >= moments[max(most - 1, 0)]) & (stamps <= moments[min(most + 2, len(moments) - 1)])]
    near = near[np.unique(np.linspace(0, len(near) - 1, TRIED).round().astype(int))]
    for pair in itertools.pairwise(near):
        yield Turns.of(log, best.turns.sensor, np.array(pair))


@dataclass(frozen=True, eq=False)
class Turns:
    """The unknowns of a log (`teamslam.model.Unknowns`) that are how one `sensor` is turned from where it is stated at
    `moments` [s], evenly between these and not beyond: the log as it is `stated`, the `values` (k,), and the `tables`
    that these make."""

    stated: Dataset
    sensor: Sensor
    moments: Array
    values: Array
    tables: tuple[Table, ...]

    @classmethod
    def of(cls, log: Dataset, sensor: Sensor, moments: Array, values: Array | None = None) -> Dataset:
        """The log with its sensor turned so, at first as it states it."""
        stated = replace(log, unknowns=None)
        if values is None:
            values = np.zeros(len(moments) * _angles(sensor))
        tables = tuple(_turned(table, sensor, moments, values, stated) for table in stated.tables)
        return replace(stated, tables=tables, unknowns=cls(stated, sensor, moments, values, tables))

    @property
    def each(self) -> tuple[Unknown, ...]:
        """What is unknown: each turn at each moment [rad]."""
        robot, (source, _, _) = self.sensor
        of = f"robot {self.stated.names.robot(robot)}, sensor of {source}"
        turns = [f"turn about its {axis}" for axis in ("x", "y", "z")[-_angles(self.sensor) :]]
        return tuple(
            Unknown(
                of, f"{turn} at {moment:.1f} s", "rad", 0.0, TURN, SMALL, STEP, quiet=True, course=turn, at_s=moment
            )
            for moment in self.moments.tolist()
            for turn in turns
        )

    @property
    def truths(self) -> dict[int, tuple[IntArray, Array]]:
        """None may be late: no clock is unknown."""
        return {}

    def again(self, values: Array) -> Dataset:
        """The log, were they `values` (k,)."""
        return Turns.of(self.stated, self.sensor, self.moments, values)

    def truth_with(self, stamps: Mapping[int, Stamps]) -> Values | None:
        """The truth, whatever the stamps."""
        return self.stated.truth

    def varied(self, values: Array, standing: Standing | None = None) -> tuple[Table, ...]:
        """Those sightings that would be others, were they."""
        mine = (table for table in self.stated.tables if _is(table, self.sensor))
        return tuple(_turned(table, self.sensor, self.moments, values, self.stated) for table in mine)


def _sensors(log: Dataset) -> Iterator[Sensor]:
    """Those by which robots see directions of landmarks, in images enough."""
    kinds = {(t.robot, t.kind) for t in log.tables if t.model in MODELS and not t.own.all()}
    for sensor in sorted(kinds):
        if len(_moments(log, sensor)) >= MOMENTS[0]:
            yield sensor


def _images(log: Dataset, sensor: Sensor) -> Array:
    """When a sensor saw anything [s]."""
    seen = [log.names.stamps_s(table.keys[:, 0]) for table in log.tables if _is(table, sensor)]
    return np.unique(np.concatenate([np.zeros(0), *seen]))


def _moments(log: Dataset, sensor: Sensor) -> Array:
    """The moments [s] of a sensor, images of its own."""
    stamps = _images(log, sensor)
    count = min(len(stamps) // EACH, MOMENTS[1])
    return stamps[np.linspace(0, len(stamps) - 1, count).round().astype(int)] if count else np.zeros(0)


def _is(table: Table, sensor: Sensor) -> bool:
    return (table.robot, table.kind) == sensor and table.model in MODELS and not table.own.all()


def _angles(sensor: Sensor) -> int:
    return 1 if sensor[1][2] == 2 else 3


def _turned(table: Table, sensor: Sensor, moments: Array, values: Array, log: Dataset) -> Table:
    """A table as it would be, were its sensor not turned: directions that were seen turn with it."""
    if not _is(table, sensor) or not values.any():
        return table
    stamps, at = log.names.stamps_s(table.keys[:, 0]), values.reshape(len(moments), -1)
    by = np.stack([np.interp(stamps, moments, each) for each in at.T], -1)
    turn, space = rotations(table.dim).exp(by), directions(table.dim)
    if table.model == "point":
        whitening = table.whitening @ np.swapaxes(turn, -1, -2)
        return replace(table, values=(turn @ table.values[..., None])[..., 0], whitening=whitening)
    ahead = table.row.z_size(table.dim) - space.SIZE
    seen = space.of((turn @ space.ray(table.values[:, ahead:])[..., None])[..., 0])
    return replace(table, values=np.concatenate([table.values[:, :ahead], seen], 1))
