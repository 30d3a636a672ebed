"""Rows of the world (GPS, a survey) that were written in other units than metres, mirrored, or in a world of their own.

They bend a map as a whole, so they are compared with one that is made `blind`, without any of them: it is right but for
where it lies. Each group of rows (a robot's of one kind) is laid upon it by a rigid motion,

    as written; with its lengths in other units; with left and right exchanged; with both,

and where one of these leaves far less of its own size than the first, it is what was meant. Groups that fit the blind
map each, but by different motions, are of different worlds. How the axes of a world are turned belongs to the motion:
nobody can tell x for y from x for -y.

What is found is told if most of what all rows cost too much is gone with it. Bound: one join of the log without these
rows, and two solves of all of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from teamslam.errors import TeamslamError
from teamslam.geometry import Array, Pose, align
from teamslam.joining import build, join, split
from teamslam.joining.exact.gap import point_of
from teamslam.model import Dataset, Kind, Loss, Names, Table, Values, is_pose, pack, told_by
from teamslam.model.sensors import pose_of
from teamslam.solver import Options, System, optimise
from teamslam.trust.cause import Cause, rows_called
from teamslam.trust.causes.slips import TOO, Slip, slips
from teamslam.trust.causes.trial import log_determinant

FEWEST = 4  # rows of a group more than a motion has places
LEFT = 0.2  # of how far a group is off, that is left as it is meant
APART = 10.0  # times as far off by the motion of another group as by its own
EXPLAINED = 0.8  # of the excess cost of all rows
COSTLY = 1.5  # times what is expected, from which there is something to explain
EXCHANGED = "axes y x z"  # the slip that stands for all that exchange left and right
ROBUST = Loss("huber", 3.0)
QUICK = Options(max_iterations=25, decrement=0.05, elsewhere=False)


Name = tuple[int, tuple[str, str, int]]


def name_of(table: Table) -> Name:
    """The robot and kind of a table."""
    return table.robot, table.kind


@dataclass(frozen=True, eq=False)
class Group:
    """Rows of the world `as_written`, read `by` slips that are undone, and where the blind map has them (`places`, m by
    dim); that may be moved in as many dimensions as robots `move`."""

    as_written: Table
    places: Array
    move: int
    by: tuple[Slip, ...] = ()

    @cached_property
    def table(self) -> Table:
        """As it is meant."""
        table = self.as_written
        for slip in self.by:
            table = slip.undone(table)
        return table

    @property
    def name(self) -> Name:
        """Whose they are, and of which kind: who wrote these wrote others of this name alike."""
        return name_of(self.as_written)

    @property
    def goals(self) -> Array:
        """Where they say to be (m, dim)."""
        return self.table.values[:, : self.table.dim]

    @cached_property
    def motion(self) -> Pose:
        """That lays the blind map on them best."""
        return align(self.places[:, : self.move], self.goals[:, : self.move]).pose

    def beside(self, motion: Pose) -> Array:
        """How they lie beside the blind map moved so (m, dim) [m]."""
        return self.goals - motion.lift(self.table.dim).act(self.places)

    def off(self, motion: Pose) -> float:
        """How far they are from it in the middle [m]."""
        return float(np.median(np.linalg.norm(self.beside(motion), axis=-1)))

    @property
    def left(self) -> float:
        """How far they are off by their own motion, beside how far they are from each other."""
        return self.off(self.motion) / max(float(np.std(self.goals, 0).max()), np.finfo(float).tiny)

    @property
    def unlikely(self) -> float:
        """-2 log of how likely they are by their own motion, as far as it depends on their noise."""
        off = np.zeros((len(self.goals), self.table.whitening.shape[-1]))
        off[:, : self.table.dim] = self.beside(self.motion)
        squared = np.sum(np.einsum("...ij,...j->...i", self.table.whitening, off) ** 2, -1)
        return float(self.table.loss.cost(squared).sum()) - 2.0 * log_determinant(self.table)


def mistakes_in_the_world(log: Dataset) -> list[Cause]:
    """What is wrong with a log's rows of the world, each with what takes it out of the log.

    Law: rows that were written in another unit, mirrored, or moved by a rigid motion are named so; none that a map of
    all rows explains are.
    """
    if sum(len(t) for t in log.tables if t.row.unary) < FEWEST:
        return []
    forgiving = log.with_tables(t.with_loss(ROBUST) for t in log.tables)
    eyes = forgiving.with_tables(t for t in forgiving.tables if not t.row.unary)
    try:
        blind = join([build(piece) for piece in split(eyes)])
        maps = [point_of(component.map) for component in blind.components]
        return [cause for values in maps for cause in _in_one_map(forgiving, values)]
    except TeamslamError:
        return []


def _in_one_map(log: Dataset, values: Values) -> list[Cause]:
    """What is wrong with the rows of the world that speak of one map."""
    written = list({group.name: group for group in sorted(_groups(log, values), key=_rows)}.values())
    if not written:
        return []
    meant = [_as_meant(group) for group in written]
    main = max(meant, key=_rows)
    slipped = [group for group in meant if group.by]
    apart = [group for group in meant if group.off(main.motion) > APART * group.off(group.motion)]
    if not slipped and not apart:
        return []
    causes = [*_slips_in_words(slipped, log.names), *(_apart_in_words(group, main, log.names) for group in apart)]
    explains = _explained(log, causes, values, written, main)
    return [replace(cause, explains=explains) for cause in causes] if explains > EXPLAINED else []


def _groups(log: Dataset, values: Values) -> Iterator[Group]:
    """The tables of which the blind map can tell enough rows, each of a whole place."""
    move = min(Kind(kind).dim for kind in values.layout.kinds[is_pose(values.layout.keys)].tolist())
    for table in log.tables:
        if table.row.unary:
            told = table.select(table.told_by(values.layout) & (table.ranks >= table.dim))
            if len(told) >= FEWEST + table.dim:
                yield Group(told, told.predict(values)[:, : told.dim], min(move, told.dim))


def _rows(group: Group) -> int:
    return len(group.places)


def _as_meant(written: Group) -> Group:
    """The group as it fits the blind map best; as written where nothing fits far better."""
    units, mirrors = _slips(written.as_written)
    tried = [replace(written, by=(*unit, *mirror)) for unit in [(), *units] for mirror in [(), *mirrors]]
    least = min(group.left for group in tried)
    if least > LEFT * written.left:
        return written
    near = [group for group in tried if group.left < 2.0 * least]
    fewest = min(len(group.by) for group in near)
    return min((group for group in near if len(group.by) == fewest), key=lambda group: group.unlikely)


def _slips(table: Table) -> tuple[list[tuple[Slip]], list[tuple[Slip]]]:
    """Units, and what exchanges left and right: that of whole poses tells itself by how they are turned."""
    some = slips("point" if table.model == "position" else "relative_pose", table.dim)
    mirrors = [(slip,) for slip in some if slip.name == EXCHANGED and table.model == "position"]
    return [(slip,) for slip in some if slip.kind == "unit"], mirrors


# --- what it explains -------------------------------------------------------------------------------------------------


def _explained(log: Dataset, causes: Sequence[Cause], values: Values, written: Sequence[Group], main: Group) -> float:
    """The share of the excess cost of all rows that is gone without what was found; 0 where they cost what they
    should."""
    mended = log
    for cause in causes:
        assert cause.mend is not None
        mended = cause.mend(mended)
    move = main.move
    both = [
        np.concatenate([part[:, :move] for part in parts])
        for parts in zip(*((g.places, g.goals) for g in written), strict=True)
    ]
    together = align(*both).pose
    (before, due), (after, _) = _solved(log, values, together), _solved(mended, values, main.motion)
    return (before - after) / (before - due) if before > COSTLY * due else 0.0


def _solved(log: Dataset, values: Values, motion: Pose) -> tuple[float, float]:
    """What all rows cost that speak of a map, solved from where a motion takes it, and what they should at most."""
    tables = told_by(log.tables, values.layout)
    system = System(values.layout, tables=tables, fixed=np.zeros(0, np.int64))
    dof = sum(table.dof for table in tables) - values.layout.dof
    return optimise(system, values.transform(motion), QUICK).cost, float(max(dof, 1))


# --- words ------------------------------------------------------------------------------------------------------------


def _slips_in_words(found: Sequence[Group], names: Names) -> Iterator[Cause]:
    """A sentence for each slip in rows of one source, of all robots whose rows hold it."""
    alike: dict[tuple[object, ...], list[Group]] = {}
    for group in found:
        what = tuple(slip.name.removesuffix(f" {TOO}") for slip in group.by)
        alike.setdefault((group.as_written.source, *what), []).append(group)
    for same in alike.values():
        one = same[0]
        looks = " and ".join(MIRRORED if slip.name == EXCHANGED else slip.looks for slip in one.by)
        off = f"{one.off(one.motion):.2g} m off so, and {replace(one, by=()).left:.0%} of their extent as written"
        said = f"{_whose(same, names)}: {looks}; beside the map that is made without them they are {off}"
        kind = "unit" if any(slip.kind == "unit" for slip in one.by) else "axes"
        mends = {group.name: group.by for group in same}
        yield Cause(kind, said, 0.0, tuple(sorted({g.as_written.robot for g in same})), partial(_undone, mends=mends))


MIRRORED = (
    "left and right are exchanged: they fit as (y, x) where (x, y) is written, as with north before east, or with the "
    "sign of one of these changed"
)


def _apart_in_words(group: Group, main: Group, names: Names) -> Cause:
    middle = group.places[:, : group.move].mean(0)
    way = float(np.linalg.norm(main.motion.act(middle) - group.motion.act(middle)))
    said = (
        f"{_whose([group], names)} are of another world than {_whose([main], names)}: each fits the map that is made "
        f"without them ({group.off(group.motion):.2g} m off), and they lie {way:,.6g} m from each other"
    )
    mend = partial(_moved, which=group.name, motion=main.motion @ group.motion.inverse())
    return Cause("frame", said, 0.0, (group.as_written.robot,), mend)


def _whose(groups: Sequence[Group], names: Names) -> str:
    robots = sorted({group.as_written.robot for group in groups})
    return f"{names.these(robots)}, {rows_called(groups[0].as_written.source)}"


def _undone(log: Dataset, mends: dict[Name, tuple[Slip, ...]]) -> Dataset:
    """The log without slips in some of its tables."""

    def meant(table: Table) -> Table:
        for slip in mends.get(name_of(table), ()):
            table = slip.undone(table)
        return table

    return log.with_tables(map(meant, log.tables))


def _moved(log: Dataset, which: Name, motion: Pose) -> Dataset:
    """The log with some of its rows of the world moved."""

    def moved(table: Table) -> Table:
        if name_of(table) != which:
            return table
        way = motion.lift(table.dim)
        if table.model == "position":
            return replace(table, values=way.act(table.values))
        return replace(table, values=pack(way @ pose_of(table.values, table.dim)))

    return log.with_tables(map(moved, log.tables))
