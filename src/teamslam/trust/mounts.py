"""Sensors that sit elsewhere on their robots than the log has it: a lever arm that nobody stated, a camera that looks
down, a laser that was mounted askew.

Where a map does not fit and no mistake is found in the log, the places and turns of all sensors by which robots see are
taken for unknown on one stretch of it and estimated with its map, the least contradicted left as stated (see
`unknowns`). They are told where the stretch costs so much less with the sensors there that it is beyond doubt, and most
of its excess is gone. The whole log is then mapped with these sensors as unknowns, and what stays uncertain of them is
in the covariances of its map.

Bound: one stretch, solved once more for each step to where the sensors are.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, rotations
from teamslam.model import Dataset, Stamps, Standing, Table, Unknown, Values
from teamslam.solver import Options
from teamslam.trust.cause import Cause, rows_called
from teamslam.trust.causes.alone import POORLY, SURE
from teamslam.trust.causes.stretches import busiest
from teamslam.trust.causes.trial import Trial
from teamslam.trust.residuals import Rows
from teamslam.trust.unknowns import settled

SUSPECT = 1.3  # times the expected cost: a stretch that costs less needs no explanation
EXPLAINED = 0.85  # of its excess
MOST = 12  # sensors of a log: of more, all that each may be wrong in is too much to ask of a stretch
PLACE, TURN = 0.5, 0.5  # [m, rad]: how far from its stated place a sensor may be, a standard deviation
USEFUL = (0.05, 0.02)  # [m, rad]: how well a place must be told to be said to be confirmed
STEPS = (0.3, 0.2)  # [m, rad]: at most, before all is linearised again
EACH = 10  # numbers that a sensor measures for each that is unknown of it: of fewer, it would explain some wrong ones
SMALL = 1e-4
QUICK = Options(max_iterations=50, decrement=0.01)

Sensor = tuple[int, tuple[str, str, int]]


def misplaced(log: Dataset, rows: Sequence[Rows]) -> list[Cause]:
    """The sensors of a log that sit elsewhere than it states, in words, with what places them; `rows` are what a map
    leaves of it. None of a log that rests on other things that are unknown."""
    if not 0 < len(_telling(log)) <= MOST or log.unknowns is not None:
        return []
    as_it_is = Trial.of(busiest(log, rows))
    sensors = _telling(as_it_is.log)
    if not sensors or not as_it_is.optima or as_it_is.loudness < SUSPECT:
        return []
    found = settled(Mounts.of(as_it_is.log, sensors), QUICK)
    moved = [] if found is None or found.why else [each.told for each in found.found]
    if found is None or not any(moved):
        return []
    there = Trial(replace(found.log, unknowns=None))
    gone = as_it_is.bulk - there.bulk
    if there.ratio > POORLY or gone < max(SURE * there.loudness, EXPLAINED * (as_it_is.bulk - as_it_is.expected)):
        return []
    of_each = zip(sensors, np.split(np.array(moved), _ends(sensors)), strict=True)
    told = [sensor for sensor, part in of_each if part.any()]
    return list(_in_words(told, log, as_it_is, there))


def _in_words(told: Sequence[Sensor], log: Dataset, as_it_is: Trial, there: Trial) -> Iterator[Cause]:
    """A sentence for each kind of sensor that sits elsewhere, and what makes the place of all of that kind unknown."""
    for source in dict.fromkeys(kind[0] for _, kind in told):
        robots = tuple(sorted({robot for robot, kind in told if kind[0] == source}))
        who = "all robots" if len(robots) > 1 and set(robots) == set(log.robots) else log.names.these(robots)
        sits = "its sensor sits or looks" if len(robots) == 1 else "their sensors sit or look"
        said = (
            f"{who}, {rows_called(source)}: {sits} elsewhere than stated; a stretch that costs {as_it_is.cost:,.0f} "
            f"costs {there.cost:,.0f} where that is estimated ({there.expected:,.0f} expected)"
        )
        explains = (as_it_is.cost - there.cost) / max(as_it_is.cost - as_it_is.expected, 1.0)
        yield Cause("mount", said, float(np.clip(explains, 0.0, 1.0)), robots, partial(_unknown, sources=(source,)))


def _unknown(log: Dataset, sources: Sequence[str]) -> Dataset:
    """The log with the places of all sensors of some sources among its unknowns, beside those that are."""
    known = log.unknowns.sensors if isinstance(log.unknowns, Mounts) else ()
    stated = log.unknowns.stated if isinstance(log.unknowns, Mounts) else log
    own = (_sensor(table) for table in log.tables if table.source in sources and _sees(table))
    return Mounts.of(stated, list(dict.fromkeys((*known, *own))))


@dataclass(frozen=True, eq=False)
class Mounts:
    """The unknowns of a log (`teamslam.model.Unknowns`) that are where `sensors` sit on their robots and how they are
    turned there: the log as it is `stated`, the `values` (k,), and the `tables` that these make."""

    stated: Dataset
    sensors: tuple[Sensor, ...]
    values: Array
    tables: tuple[Table, ...]

    @classmethod
    def of(cls, log: Dataset, sensors: Sequence[Sensor], values: Array | None = None) -> Dataset:
        """The log with its sensors there, at first where it states them."""
        stated = replace(log, unknowns=None)
        if values is None:
            values = np.array([unknown.stated for sensor in sensors for unknown in _unknowns_of(sensor, stated)])
        by = _changes(sensors, stated, values)
        tables = tuple(_moved(table, by) for table in stated.tables)
        return replace(stated, tables=tables, unknowns=cls(stated, tuple(sensors), values, tables))

    @property
    def each(self) -> tuple[Unknown, ...]:
        """What is unknown."""
        return tuple(unknown for sensor in self.sensors for unknown in _unknowns_of(sensor, self.stated))

    @property
    def truths(self) -> dict[int, tuple[IntArray, Array]]:
        """None may be late: no clock is unknown."""
        return {}

    def again(self, values: Array) -> Dataset:
        """The log, were they `values` (k,)."""
        return Mounts.of(self.stated, self.sensors, values)

    def truth_with(self, stamps: Mapping[int, Stamps]) -> Values | None:
        """The truth, whatever the stamps."""
        return self.stated.truth

    def varied(self, values: Array, standing: Standing | None = None) -> tuple[Table, ...]:
        """Those sightings that would be others, were they."""
        by = _changes(self.sensors, self.stated, values)
        return tuple(_moved(table, by) for table in self.stated.tables if _sensor(table) in by)


def _changes(sensors: Sequence[Sensor], log: Dataset, values: Array) -> dict[Sensor, Array]:
    """By how much each sensor is elsewhere than a log states it, and turned."""
    stated = np.array([unknown.stated for sensor in sensors for unknown in _unknowns_of(sensor, log)])
    return dict(zip(sensors, np.split(values - stated, _ends(sensors)), strict=True))


def _ends(sensors: Sequence[Sensor]) -> IntArray:
    return np.cumsum([_numbers(sensor) for sensor in sensors])[:-1]


def _telling(log: Dataset) -> list[Sensor]:
    """Those by which its robots see often enough to tell where they are."""
    measured = Counter[Sensor]()
    for table in log.tables:
        if _sees(table):
            measured[_sensor(table)] += int(table.ranks.sum())
    return [sensor for sensor, numbers in measured.items() if numbers >= EACH * _numbers(sensor)]


def _sensor(table: Table) -> Sensor:
    return table.robot, table.kind


def _sees(table: Table) -> bool:
    """Whether it is what a robot sees by a sensor that it carries."""
    own = table.row.unary or table.own.all()
    return not own and table.row.native and table.model != "corners"


def _numbers(sensor: Sensor) -> int:
    """Three in the plane, in which a sensor lies that measures in it; six in space."""
    return 3 if sensor[1][2] == 2 else 6


def _mount(table: Table) -> Pose:
    return (table.sensor or Pose.identity(table.dim)).lift(table.dim)


def _unknowns_of(sensor: Sensor, log: Dataset) -> Iterator[Unknown]:
    """Its place along the axes of the robot [m], and how it is turned, in space from what is stated [rad]."""
    robot, (source, _, dim) = sensor
    mount = next(_mount(table) for table in log.tables if _sensor(table) == sensor)
    of = f"robot {log.names.robot(robot)}, sensor of {source}"
    for name, stated in zip("xyz"[:dim], mount.translation.tolist(), strict=True):
        yield Unknown(of, name, "m", stated, PLACE, SMALL, STEPS[0], USEFUL[0], quiet=True)
    turns = {"theta": float(np.arctan2(mount.rotation[1, 0], mount.rotation[0, 0]))}
    if dim == 3:
        turns = {f"turn about its {axis} from what is stated": 0.0 for axis in "xyz"}
    for name, stated in turns.items():
        yield Unknown(of, name, "rad", stated, TURN, SMALL, STEPS[1], USEFUL[1], quiet=True)


def _moved(table: Table, of: Mapping[Sensor, Array]) -> Table:
    """A table with its sensor moved and turned by the numbers of it, where there are any that are not zero."""
    by = of.get(_sensor(table))
    if by is None or not by.any():
        return table
    mount = _mount(table)
    turned = mount.rotation @ rotations(table.dim).exp(by[table.dim :])
    return replace(table, sensor=Pose(turned, mount.translation + by[: table.dim]))
