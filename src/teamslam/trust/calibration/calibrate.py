"""What the data show to be wrong with the model of the data, in one record, and the log put right by it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.joining import AtMap, cost_of
from teamslam.joining.exact.gap import Gap, frame_of, point_of, rows_in
from teamslam.model import Dataset, Names, Submap, Table, Values
from teamslam.trust.calibration.carried import carrying, held
from teamslam.trust.calibration.changed import Change, beyond, put_right
from teamslam.trust.calibration.estimate import Estimate, changes_of, estimate, systematic_of
from teamslam.trust.calibration.persistence import Persistence
from teamslam.trust.calibration.sigmas import Sigmas, sigmas_of
from teamslam.trust.calibration.slips import SLIPS
from teamslam.trust.calibration.still import PutRight
from teamslam.trust.calibration.systematic import Systematic

WILD = 10.0
AS_STATED = ("corners",)
"""Models of sightings with whose maps nothing is done. Errors of corners hang together from image to image (0.8 over a
second): what one image adds to the place of a tag is little, and what two images say of the motion between them is
much. To weigh each image down says the first and forgets the second: odometry then bends the map."""


@dataclass(frozen=True)
class Scale:
    """One part of one sensor of a robot: its errors are `scale` times as large as stated."""

    robot: int
    source: str
    part: str
    scale: float


@dataclass(frozen=True)
class Slip:
    """Noise of all robots' odometry beyond what is stated: its root `density` (rad or m, per root second)."""

    name: str
    density: float


@dataclass(frozen=True)
class Lasting:
    """How errors of one part of a kind of sighting hang together in time, and for how many of them one `counts`, in the
    middle."""

    source: str
    part: str
    persistence: Persistence
    counts: float


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is wrong with the model of the data, and what is to be done about it: nothing, if all are empty. `moved`:
    where the maps go when it is put right, to first order; `sigmas`: what theirs come from."""

    systematic: tuple[Systematic, ...] = ()
    scales: tuple[Scale, ...] = ()
    slips: tuple[Slip, ...] = ()
    lasting: tuple[Lasting, ...] = ()
    names: Names = field(default_factory=Names)
    changes: tuple[Change, ...] = ()
    moved: tuple[Values, ...] = ()
    sigmas: tuple[Sigmas, ...] = ()

    def __bool__(self) -> bool:
        """Whether the data show anything wrong."""
        return bool(self.systematic or self.scales or self.slips or self.lasting)

    @property
    def wild(self) -> bool:
        """Whether errors are so much larger than stated that they are no noise: the log is wrong, or its map."""
        return any(scale.scale > WILD for scale in self.scales)

    def put_right(self, log: Dataset, *, weigh: bool = True) -> Dataset:
        """The log with every measurement put right, weighed by what it counts; without `weigh`, as it is alone."""
        return log.with_tables(put_right(log.tables, self.changes, weigh=weigh)) if self else log

    def start_of(self, submap: Submap) -> Values:
        """Where to start from when a submap is made again of what was put right: its variables, its base among them, as
        the map that holds them all goes; as they are where none does."""
        values = submap.all_values if submap.base >= 0 else submap.values
        layout = values.layout
        for moved in self.moved:
            there = moved.layout.contains(layout.keys).all()
            if there and np.array_equal(moved.layout.kinds[moved.layout.index(layout.keys)], layout.kinds):
                return moved.seen_from(moved.pose(submap.base), layout) if submap.base >= 0 else moved.only(layout.keys)
        return values

    def carried_by(self, submap: Submap, rows: Sequence[Table], gap: Gap | None = None) -> Submap:
        """The submap of `rows` that were put right, with systematic errors among its variables (see `carried`)."""
        return carrying(submap, rows, self.systematic, self.changes, gap)

    def at(self, map: Submap, log: Dataset) -> AtMap:
        """The log put right, at a map of it."""
        return PutRight(self.put_right(log).tables, map, self.changes)

    def carried_on(self, map: Submap, rows: Sequence[Table], gap: Gap | None = None) -> tuple[Submap, "Calibration"]:
        """The map of all `rows`, put right, with their systematic errors among its variables, and the calibration as
        that map holds it: it has moved on with them. `gap`: that of these rows where the map is, with whose information
        it is, where it is known."""
        carries = self.carried_by(map, rows, gap)
        systematic = held(carries, rows, self.systematic)
        further = [(was, now.value - was.value) for was, now in zip(self.systematic, systematic, strict=True)]
        changes = tuple(change.further(further, rows) for change in self.changes)
        return carries, replace(self, changes=changes, systematic=systematic)

    def cost(self, map: Submap, log: Dataset) -> float:
        """What a log that is put right costs at a map of it, beside what the systematic errors themselves do:
        sum |W'' e|^2 + sum |D e|^2 + sum |p / prior|^2."""
        rows = rows_in(map, self.put_right(log).tables)
        return self.cost_of(map, rows, cost_of(map, rows).cost)

    def cost_of(self, map: Submap, rows: Sequence[Table], alone: float) -> float:
        """The same of a map's `rows` that were put right, from what these cost `alone`."""
        told = beyond(rows, self.changes, point_of(map), frame_of(map), map.names)
        errors = sum((error.value / error.prior) ** 2 for error in self.systematic)
        return alone + (0.0 if told is None else told[2]) + errors


def calibrate(at: Sequence[AtMap]) -> Calibration:
    """What is wrong with the model of a log, from the log at the map of each component. Nothing where its rows do not
    determine a map, or none is to spare, or which rests on sightings that are taken as stated."""
    found: list[Estimate] = []
    for part in at:
        if as_stated(part):
            continue
        try:
            each = estimate(part)
        except SolveError:
            continue
        if each is not None and not each.nothing:
            found.append(each)
    if not found:
        return Calibration()
    systematic = [error for each in found for error in systematic_of(each)]
    return Calibration(
        systematic=tuple(systematic),
        scales=tuple(scale for each in found for scale in _scales(each)),
        slips=tuple(slip for each in found for slip in _slips(each)),
        lasting=tuple(lasting for each in found for lasting in _lasting(each)),
        names=at[0].joined.names,
        changes=tuple(change for each in found for change in changes_of(each, systematic)),
        moved=tuple(each.fit.moved() for each in found),
        sigmas=tuple(sigmas for each in found for sigmas in sigmas_of(each.fit)),
    )


def as_stated(at: AtMap) -> bool:
    """Whether a map is left as its noise is stated, whatever its rows show: where it rests on any of AS_STATED."""
    return any(table.model in AS_STATED for table in at.tables)


def _scales(found: Estimate) -> list[Scale]:
    return [
        Scale(table.robot, table.source, name, float(scale))
        for table, scales in zip(found.linear.tables, found.scales, strict=True)
        for name, scale in zip(table.row.part_names(table.dim), scales, strict=True)
        if scale != 1.0
    ]


def _slips(found: Estimate) -> list[Slip]:
    return [Slip(name, float(np.sqrt(theta))) for name, theta in zip(SLIPS, found.theta, strict=True) if theta > 0.0]


def _lasting(found: Estimate) -> list[Lasting]:
    out = []
    for kind, parts in found.kinds.items():
        members = [k for k, t in enumerate(found.linear.tables) if t.kind == kind]
        table = found.linear.tables[members[0]]
        counts = np.median(np.concatenate([found.tempers[k] ** 2 for k in members]), 0)
        for name, persistence, count in zip(table.row.part_names(table.dim), parts, counts, strict=True):
            if not persistence.nothing:
                out.append(Lasting(table.source, name, persistence, float(count)))
    return out
