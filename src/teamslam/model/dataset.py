"""What was seen: everything that a team's log holds, as tables per robot, in one record.

    Dataset = robots + tables + (truth) + (initial guess) + what was dropped, and why

A piece of a log (`teamslam.split`) is a Dataset too, of one robot.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from teamslam.cards import card
from teamslam.errors import ModelError
from teamslam.geometry import FrozenDict, IntArray
from teamslam.model.keys import Names, is_landmark, is_pose, robot_of
from teamslam.model.layout import Kind, Layout, distinct, point_kind, pose_kind
from teamslam.model.losses import Loss
from teamslam.model.tables import Table
from teamslam.model.unknowns import Unknowns
from teamslam.model.values import Values


@dataclass(frozen=True)
class Dropped:
    """Rows of the input that were left out: how many, and why, in words."""

    count: int
    reason: str


@dataclass(frozen=True, eq=False)
class Dataset:
    """A team's measurements.

    `robots` maps each robot's number to the dimension it moves in (2 or 3). Every pose that a table names belongs to
    one of them (ModelError otherwise). `truth` and `initial` are partial: values of some of the same keys, in any one
    frame. `dropped` says what the reader left out, `notes` in words how it understood what can be read in several ways.
    `unknowns` are numbers that the rows rest on and nobody measured, where the reader knows of any.
    """

    robots: dict[int, int]
    tables: tuple[Table, ...]
    names: Names = field(default_factory=Names)
    truth: Values | None = None
    initial: Values | None = None
    dropped: tuple[Dropped, ...] = ()
    notes: tuple[str, ...] = ()
    origin: str = ""
    unknowns: Unknowns | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.robots, FrozenDict):
            object.__setattr__(self, "robots", FrozenDict(self.robots))
        for table in self.tables:
            strangers = set(np.unique(robot_of(table.keys[is_pose(table.keys)])).tolist()) - set(self.robots)
            if strangers:
                raise ModelError(
                    f"{table.source} of robot {self.names.robot(table.robot)} name robot {min(strangers)}, which is "
                    f"not in the team ({', '.join(self.names.robot(r) for r in sorted(self.robots))})"
                )

    @cached_property
    def layout(self) -> Layout:
        """All variables that the tables speak of. A landmark is a pose where a table measures its orientation, else a
        point; it lives in space where any table sees it in space."""
        keys, kinds = [], []
        for table in self.tables:
            poses = distinct(table.keys[is_pose(table.keys)])
            keys.append(poses)
            kinds.append(self.robot_kinds(robot_of(poses)))
            marks = distinct(table.keys[is_landmark(table.keys)])
            keys.append(marks)
            kinds.append(np.full(len(marks), int((pose_kind if table.row.targets_pose else point_kind)(table.dim))))
        if not sum(map(len, keys)):
            return Layout.of(np.zeros(0), np.zeros(0))
        all_keys, all_kinds = np.concatenate(keys), np.concatenate(kinds)
        # Several tables may see one landmark: space beats the plane, and a pose beats a point.
        order = np.argsort(all_keys, kind="stable")
        all_keys, all_kinds = all_keys[order], all_kinds[order]
        starts = np.flatnonzero(np.append(True, all_keys[1:] != all_keys[:-1]))
        oriented = np.maximum.reduceat((all_kinds < 2).astype(int), starts)
        spatial = np.maximum.reduceat(all_kinds % 2, starts)
        return Layout.of(all_keys[starts], np.where(oriented == 1, spatial, 2 + spatial))

    def __repr__(self) -> str:
        known = [f"{len(self.robots)} robots", f"{sum(map(len, self.pose_keys.values())):,} poses"]
        known += [f"{len(self.landmark_keys):,} landmarks", f"{sum(map(len, self.tables)):,} rows"]
        known += ["with truth"] * (self.truth is not None) + [f"from {self.origin}"] * bool(self.origin)
        return f"Dataset({', '.join(known)})"

    def _repr_html_(self) -> str:
        from teamslam.model.portrait import log_portrait

        poses, rows = sum(map(len, self.pose_keys.values())), sum(map(len, self.tables))
        named = ", ".join(self.names.robot(robot) for robot in sorted(self.robots))
        facts = [
            ("robots", f"{len(self.robots)}: {named}"),
            ("poses", f"{poses:,}"),
            ("landmarks", f"{len(self.landmark_keys):,}"),
            ("rows", f"{rows:,} in {len(self.tables)} tables"),
            ("truth", "no" if self.truth is None else f"of {len(self.truth):,} variables"),
            *(("dropped", f"{dropped.count:,}: {dropped.reason}") for dropped in self.dropped),
            *(("read", note) for note in self.notes),
        ]
        return card(self.origin or "A team's log", facts, picture=log_portrait(self.tables, self.names))

    def robot_kinds(self, robots: IntArray) -> IntArray:
        """The kind of pose of each robot number."""
        lookup = np.zeros(max(self.robots, default=0) + 1, np.int64)
        for number, dim in self.robots.items():
            lookup[number] = int(pose_kind(dim))
        return np.asarray(lookup[robots])

    @cached_property
    def pose_keys(self) -> dict[int, IntArray]:
        """The keys of each robot's own poses, in time order."""
        poses = self.layout.keys[is_pose(self.layout.keys)]
        return {robot: np.sort(poses[robot_of(poses) == robot]) for robot in sorted(self.robots)}

    @cached_property
    def landmark_keys(self) -> IntArray:
        """The keys of all landmarks seen."""
        return np.sort(self.layout.keys[is_landmark(self.layout.keys)])

    @property
    def dof(self) -> int:
        """Numbers measured in all."""
        return sum(table.dof for table in self.tables)

    def of_robot(self, robot: int) -> "Dataset":
        """What one robot measured itself: its own log."""
        return self.with_tables(t for t in self.tables if t.robot == robot)

    def with_tables(self, tables: Iterable[Table]) -> "Dataset":
        """The same team with other tables."""
        return replace(self, tables=tuple(tables))

    def with_loss(self, loss: Loss, *, odometry: bool = False) -> "Dataset":
        """The same log with a robust loss on every sighting; odometry is trusted unless asked for."""
        return self.with_tables(
            t if t.source == "odometry" and not odometry else t.with_loss(loss) for t in self.tables
        )

    @property
    def is_planar(self) -> bool:
        """True where every robot moves in the plane (landmarks may be in space)."""
        return all(dim == 2 for dim in self.robots.values())

    @property
    def dim(self) -> int:
        """2 where everything lives in the plane, else 3."""
        return 2 if all(Kind(int(k)).dim == 2 for k in np.unique(self.layout.kinds)) else 3
