"""The books of a join: whatever went in and is in no map, with the reason (see `model.account`).

It is found by what is missing, not by what was noted on the way, so nothing can be forgotten: rows are looked up in the
sources of the maps, less those that still wait for something, and variables among the maps' own.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining.join.bystanders import Bystander, of_these, without_bystanders
from teamslam.joining.join.join import Joined
from teamslam.joining.join.nearer import nearer_than_known
from teamslam.joining.join.second_places import second_places, sentences, undecided
from teamslam.joining.join.why_open import WORLD_OPEN, why_open
from teamslam.model import (
    SQUARED,
    Dataset,
    Kind,
    Layout,
    LeftOut,
    Names,
    Sources,
    Submap,
    Table,
    is_landmark,
    is_pose,
    robot_of,
)

APART = "they tie together what is in different maps, or they name what is in none"
FORGIVEN = (
    "no map holds them: their own robot measured nothing from there, and where others saw them a loss forgives; such a"
    " sighting could be wrong, and nothing else tells; a second row about that pose would, or a squared loss"
)
UNSEEN = "no map holds them: nothing was measured from there, and what others saw of them leaves part of them open"
SEEN = "no map holds them: what was seen from there, or of them, leaves part of them open"
SEEN_OR_FORGIVEN = SEEN + ", but for what a loss forgives, which could be wrong"
ALONE = "no odometry leads to it or from it, and nothing seen from there fixes a place by itself"
CONTRADICT = (
    "with them no optimum was found, and the map of the rest has them far off: they, or their stamps, may be wrong"
)
NEARER = (
    "with them no optimum was found: what they see is nearer to the sensor than the map knows how the two lie, so the"
    " way in which it lies from there is open"
)
FORGIVE = "; where some are, `--loss huber` lets them pull less, and `--reject` leaves them out"
TURNED = "they leave part of how their target is turned open, so all that is known of it is where it is"


@dataclass(frozen=True, eq=False)
class Unbuilt:
    """A piece of log that no submap could be built of, and why."""

    piece: Dataset
    reason: str


def accounted(
    log: Dataset, joined: Joined, unbuilt: Sequence[Unbuilt] = (), stood_by: Sequence[Bystander] = ()
) -> Joined:
    """The join with all that is in none of its maps. Law: what `log` holds is in one of the maps or in `left_out`,
    every variable and every row once. Robots that brought nothing and landmarks with two places are remarks. A map that
    would hold one pose and nothing else, or nothing that others do not place, is none: such poses stood by, as those
    did that are known to have `stood_by`. Raises SolveError where there is no other map."""
    joined, lone = _without_lone(log, joined)
    joined, found = without_bystanders(joined)
    books = _Books(log, [c.map for c in joined.components])
    left_out = tuple(books.entries([*unbuilt, *lone], [*stood_by, *found]))
    silent = [log.names.robot(robot) for robot, poses in log.pose_keys.items() if not len(poses)]
    remarks = [f"robot {name} measured nothing, and nobody saw it: it is in no map" for name in silent]
    twofold = [second_places(c.map, log.tables) for c in joined.components]
    for component, two in zip(joined.components, twofold, strict=True):
        remarks += sentences(component.map, two)
    pairs = zip(joined.components, twofold, strict=True)
    components = tuple(replace(component, second_places=tuple(undecided(two))) for component, two in pairs)
    return replace(joined, components=components, left_out=left_out, remarks=(*joined.remarks, *remarks), log=log)


def _without_lone(log: Dataset, joined: Joined) -> tuple[Joined, list[Unbuilt]]:
    """The join without maps that hold one pose and nothing else, and these with why."""
    reasons = ["", *joined.reasons]
    held = [bool(component.map.dof) for component in joined.components]
    lone = [
        _alone(log, component.map, reason)
        for component, reason, holds in zip(joined.components, reasons, held, strict=True)
        if not holds
    ]
    if not any(held):
        raise SolveError(lone[0].reason)
    return of_these(joined, held), lone


def _alone(log: Dataset, lone: Submap, reason: str) -> Unbuilt:
    """The rows of a pose that no map could hold."""
    own = [t.select(t.keys[:, 0] == lone.base) for t in log.tables if t.robot == robot_of(lone.base)]
    alone = f"{lone.names.describe(lone.base)} stands alone: {ALONE}"
    return Unbuilt(log.with_tables(t for t in own if len(t)), f"{reason}; {alone}" if reason else alone)


def accounted_raw(submaps: Iterable[Submap], joined: Joined) -> Joined:
    """The join with all that its submaps carried raw and that none of its maps could use, where the log itself is not
    at hand. Rows about poses that no submap here holds are not lost: they stay with the map, which is a remark."""
    raw = [table for submap in submaps for table in submap.raw if len(table)]
    if not raw:
        return joined
    maps = [component.map for component in joined.components]
    poses = np.unique(np.concatenate([m.keys[is_pose(m.keys)] for m in maps]))
    here = [np.asarray((~is_pose(t.keys) | np.isin(t.keys, poses)).all(1)) for t in raw]
    tables = tuple(t.select(mask) for t, mask in zip(raw, here, strict=True) if mask.any())
    robots = {int(robot_of(p)): Kind(k).dim for m in maps for p, k in _poses_in(m.all_values.layout)}
    log = Dataset(robots | {t.robot: t.dim for t in tables if t.robot not in robots}, tables, joined.map.names)
    joined, lone = _without_lone(log, joined)
    maps = [component.map for component in joined.components]
    waiting = [t.select(~mask) for t, mask in zip(raw, here, strict=True) if not mask.all()]
    remarks = [_waits(table, poses, log.names) for table in waiting]
    return replace(joined, left_out=tuple(_Books(log, maps).entries(lone)), remarks=(*joined.remarks, *remarks))


def _poses_in(layout: Layout) -> Iterator[tuple[int, int]]:
    mask = is_pose(layout.keys) & (robot_of(layout.keys) > 0)
    yield from zip(layout.keys[mask].tolist(), layout.kinds[mask].tolist(), strict=True)


def _waits(table: Table, poses: IntArray, names: Names) -> str:
    """What is said of rows about poses that are in no submap."""
    absent = table.keys[is_pose(table.keys) & ~np.isin(table.keys, poses)]
    whose = " and ".join(f"robot {names.robot(int(robot))}" for robot in np.unique(robot_of(absent)))
    one = len(table) == 1
    rows, wait = ("row", "it waits") if one else ("rows", "they wait")
    return (
        f"{len(table)} {rows} of {table.source} of robot {names.robot(table.robot)} {'speaks' if one else 'speak'} of "
        f"poses of {whose} that are in no submap here; {wait} in the map for the submaps that hold them"
    )


class _Books:
    """Rows and variables of a log that are in no map, and whom they are laid to so far."""

    def __init__(self, log: Dataset, maps: Sequence[Submap]) -> None:
        self.log, self.maps, self.names = log, maps, log.names
        self.known = np.unique(np.concatenate([*(m.keys for m in maps), np.zeros(0, np.int64)]))
        held = Sources().merge(*(m.sources for m in maps))
        waiting = [table for m in maps for table in m.raw]
        self.open = [_not_held(table, held, waiting) for table in log.tables]
        self.missing = np.setdiff1d(log.layout.keys, self.known)

    def entries(self, unbuilt: Sequence[Unbuilt], stood_by: Sequence[Bystander] = ()) -> Iterator[LeftOut]:
        """One for each thing that was left out."""
        for lost in unbuilt:
            rows = Sources.of(lost.piece.tables)
            own = lost.piece.tables[0].robot
            poses = lost.piece.pose_keys[own]
            what = (
                f"robot {self.names.robot(own)} from {self.names.describe(int(poses[0]))} on"
                if len(poses)
                else (f"rows of robot {self.names.robot(own)}")
            )
            mine = [mask & rows.rows_of(t) for t, mask in zip(self.log.tables, self.open, strict=True)]
            yield self._taken("piece", what, poses, mine, lost.reason)
        for bystander in stood_by:
            yield self._without(bystander.poses, bystander.reason)
        for key in self.missing[is_landmark(self.missing)].tolist():
            rows_of = [m & (t.keys[:, -1] == key) for t, m in zip(self.log.tables, self.open, strict=True)]
            parts = [t.select(m) for t, m in zip(self.log.tables, rows_of, strict=True) if m.any()]
            reason = why_open(key, parts, self.maps)
            yield self._taken("landmark", self.names.describe(key), np.array([key]), rows_of, reason)
        for robot in np.unique(robot_of(self.missing[is_pose(self.missing)])).tolist():
            poses = self.missing[robot_of(self.missing) == robot]
            measured = self._measured(poses)
            yield from (self._without(some) for some in (poses[measured], poses[~measured]) if len(some))
        for number, table in enumerate(self.log.tables):
            for loose, reason in self._why_loose(table, self.open[number]) if self.open[number].any() else ():
                mine = [np.zeros(len(t), bool) for t in self.log.tables]
                mine[number] = loose
                what = f"{table.source} of robot {self.names.robot(table.robot)}"
                yield self._taken("rows", what, np.zeros(0, np.int64), mine, reason)

    def _without(self, poses: IntArray, reason: str = "") -> LeftOut:
        """Poses of one robot, and all rows about them."""
        rows_of = [m & np.isin(t.keys, poses).any(1) for t, m in zip(self.log.tables, self.open, strict=True)]
        what = f"{len(poses)} pose{'' if len(poses) == 1 else 's'} of robot {self.names.robot(int(robot_of(poses[0])))}"
        return self._taken("poses", what, poses, rows_of, reason or self._why_nowhere(poses, rows_of))

    def _taken(self, kind: str, what: str, keys: IntArray, rows: Sequence[BoolArray], reason: str) -> LeftOut:
        """An entry with some of what is missing, which is then nobody else's."""
        tables = [t.select(m & o) for t, m, o in zip(self.log.tables, rows, self.open, strict=True)]
        self.open = [o & ~m for o, m in zip(self.open, rows, strict=True)]
        gone = np.intersect1d(keys, self.missing)
        self.missing = np.setdiff1d(self.missing, gone)
        tables = [t for t in tables if len(t)]
        return LeftOut(kind, what, gone, Sources.of(tables), sum(map(len, tables)), reason)

    def _why_nowhere(self, poses: IntArray, rows: Sequence[BoolArray]) -> str:
        """Why no map holds poses of which these rows speak."""
        parts = [t.select(m) for t, m in zip(self.log.tables, rows, strict=True) if m.any()]
        whole = [t for t in parts if t.model == "relative_pose" and (t.ranks == t.row.residual_rows(t.dim)).any()]
        forgiven = any(t.loss.name != "squared" for t in whole)
        if self._measured(poses).any():
            return SEEN_OR_FORGIVEN if forgiven else SEEN
        return FORGIVEN if forgiven else UNSEEN

    def _measured(self, poses: IntArray) -> BoolArray:
        """From which poses (n,) their own robot measured something that is in no map."""
        from_there = [t.keys[m, 0] for t, m in zip(self.log.tables, self.open, strict=True) if not t.row.unary]
        return np.isin(poses, np.concatenate([np.zeros(0, np.int64), *from_there]))

    def _why_loose(self, table: Table, rows: BoolArray) -> Iterator[tuple[BoolArray, str]]:
        """Why rows are in no map though all that they speak of is in some; of those that one holds, which and why."""
        whole = next((m for m in self.maps if m.all_values.layout.contains(table.keys[rows]).all()), None)
        if whole is None or table.row.unary:
            yield rows, TURNED if whole and table.sees_turns else WORLD_OPEN if table.row.unary else APART
        elif table.sees_turns:
            yield rows, TURNED
        else:
            near = np.zeros(len(rows), bool)
            near[rows] = nearer_than_known(table.select(rows), whole)
            contradict = CONTRADICT + FORGIVE * (table.loss == SQUARED)
            yield from ((mask, why) for mask, why in ((near, NEARER), (rows & ~near, contradict)) if mask.any())


def _not_held(table: Table, held: Sources, waiting: Iterable[Table]) -> BoolArray:
    """Which rows (m,) of a table are not among some, or still wait."""
    late = [t.ids for t in waiting if (t.robot, t.source) == (table.robot, table.source)]
    return np.asarray(~held.rows_of(table) | (np.isin(table.ids, np.concatenate(late)) if late else False))
