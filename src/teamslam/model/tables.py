"""Measurements are tables: many sightings of one kind by one robot, with their noise.

Noise is a whitening matrix W with covariance^-1 = W'W, one for each row or one for all; rows of W that are zero measure
nothing (`noise`). A table knows who measured (`robot`), what it is called (`source`), which rows of the robot's log
these are (`ids`), and which sensor saw it: `sensor` is the sensor's pose in the observer's body; of `position` and
`pose`, which have no observer, in the target's: the sensor is what was measured.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import AnyArray, Array, BoolArray, IntArray, Pose, Sealed, lift_points, seal
from teamslam.model.keys import is_landmark, is_pose, robot_of
from teamslam.model.layout import Kind, Layout
from teamslam.model.losses import SQUARED, Loss
from teamslam.model.noise import ranks
from teamslam.model.sensors import MODELS, Model
from teamslam.model.values import Values


@dataclass(frozen=True, eq=False)
class Table(Sealed):
    """m sightings of one model by one robot.

    `keys` (m, 2) observer then target (m, 1 for `position` and `pose`); `values` (m, size) as MODELS says; `whitening`
    (m, rows, rows) or (1, rows, rows); `dim` of the measurement; `ids` (m,) number the rows of this robot's log of this
    `source` ('odometry', 'landmarks', 'robots', ...), so that no sighting is ever counted twice. `called`: what people
    call the sensor, where a robot may have several of a kind.
    Raises ModelError where shapes, keys or numbers do not fit.
    """

    robot: int
    source: str
    model: str
    dim: int
    keys: IntArray
    values: Array
    whitening: Array
    ids: IntArray
    sensor: Pose | None = None
    loss: Loss = SQUARED
    called: str = ""

    def __repr__(self) -> str:
        return f"Table({self.source} of robot number {self.robot}: {len(self):,} rows of {self.model} in {self.dim}D)"

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ModelError(f"unknown model '{self.model}'; known are {', '.join(MODELS)}")
        if self.dim not in (2, 3):
            raise ModelError(f"a measurement lives in the plane (2) or in space (3), found dimension {self.dim}")
        m, row = len(self.keys), self.row
        if not row.z_size(self.dim):
            raise ModelError(f"{self.source}: {self.model} are not measured in dimension {self.dim}")
        size, rows = row.z_size(self.dim), row.residual_rows(self.dim)
        expected: dict[str, tuple[tuple[int, ...], list[tuple[int, ...]]]] = {
            "keys": (self.keys.shape, [(m, 1 if row.unary else 2)]),
            "values": (self.values.shape, [(m, size)]),
            "whitening": (self.whitening.shape, [(m, rows, rows), (1, rows, rows)]),
            "ids": (self.ids.shape, [(m,)]),
        }
        for name, (found, allowed) in expected.items():
            if found not in allowed:
                wanted = " or ".join(map(str, allowed))
                raise ModelError(f"{self.source} ({self.model}): {name} should have shape {wanted}, found {found}")
        for name, numbers in (("values", self.values), ("whitening", self.whitening)):
            if not np.isfinite(numbers).all():
                raise ModelError(f"{self.source} ({self.model}): {name} hold a number that is not finite")
        self._check_sensor()
        seal(self, "keys", "values", "whitening", "ids")

    def _check_sensor(self) -> None:
        if self.sensor is None:
            return
        if self.sensor.dim > self.dim:
            raise ModelError(
                f"{self.source} ({self.model}): a sensor that is mounted in space cannot measure in the plane; give "
                f"its pose in the plane (x, y, theta), or its measurements in space"
            )
        if self.row.unary and is_landmark(self.keys).any():
            raise ModelError(f"{self.source} ({self.model}): a landmark carries no sensor; leave the sensor's pose out")

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def row(self) -> Model:
        """The row of MODELS."""
        return MODELS[self.model]

    @property
    def kind(self) -> tuple[str, str, int]:
        """Source, model and dimension: rows of one kind have the same parts, whoever measured them, and are stacked;
        rows of one source and model may be of the plane and of space."""
        return self.source, self.model, self.dim

    @cached_property
    def own(self) -> BoolArray:
        """Which of its keys (m, 2 or 1) are poses of the robot that measured."""
        return np.asarray(robot_of(self.keys) == self.robot)

    @property
    def is_odometry(self) -> bool:
        """Whether it is how robots themselves moved that is measured, step by step."""
        return self.source == "odometry" and self.model == "relative_pose"

    @cached_property
    def dof(self) -> int:
        """Numbers measured in all: rows of the whitened residual, without those that say nothing."""
        return int(ranks(self.whitening).sum()) * (1 if len(self.whitening) == len(self) else len(self))

    @property
    def ranks(self) -> IntArray:
        """How many numbers each row measures (m,): fewer than its residual has where its information is singular."""
        return np.broadcast_to(ranks(self.whitening), len(self))

    def select(self, index: AnyArray) -> "Table":
        """The rows at a mask or index; itself where a mask has all of them."""
        if _marks_all(index, len(self)):
            return self
        whitening = self.whitening if len(self.whitening) == 1 else self.whitening[index]
        if len(self) == 1 and len(self.whitening) == 1:
            whitening = self.whitening
        return replace(self, keys=self.keys[index], values=self.values[index], whitening=whitening, ids=self.ids[index])

    def told_by(self, layout: Layout) -> BoolArray:
        """Which rows (m,) some variables can tell: both ends are among them, and a target of which the orientation
        counts is a pose there, not a place alone."""
        there = np.asarray(layout.contains(self.keys).all(1))
        if self.sees_turns and there.any():
            there[there] = layout.kinds[layout.index(self.keys[there, -1])] < Kind.POINT2
        return there

    @property
    def sees_turns(self) -> bool:
        """Whether it matters how the target is turned."""
        return self.row.targets_pose or (self.row.unary and self.sensor is not None)

    def with_loss(self, loss: Loss) -> "Table":
        """The same sightings under another loss."""
        return replace(self, loss=loss)

    def ends(self, values: Values) -> tuple[Pose | None, Pose | Array]:
        """The observers (None for `unary` models) and targets of all rows, planar ones lifted where kinds are mixed."""
        dim = 2 + int((values.layout.kinds[values.layout.index(self.keys)] % 2).max(initial=0))
        targets = self.keys[:, -1]
        target = values.poses_of(targets, dim) if self.sees_turns else values.positions(targets, dim)
        return None if self.row.unary else values.poses_of(self.keys[:, 0], dim), target

    def predict_from(self, observer: Pose | None, target: Pose | Array) -> Array:
        """h (m, size) of targets seen by observers' bodies (None: from the world frame), each of its own dimension."""
        of_target = target.dim if isinstance(target, Pose) else target.shape[-1]
        of_observer = observer.dim if observer is not None else 2
        dim = max(self.dim, of_target, of_observer, self.sensor.dim if self.sensor is not None else 2)
        lifted = target.lift(dim) if isinstance(target, Pose) else lift_points(target, dim)
        mount = Pose.identity(dim) if self.sensor is None else self.sensor.lift(dim)
        times = len(lifted) // max(len(self), 1)  # all rows may be seen several times over
        given = (np.tile(self.values[:, -self.row.given :], (times, 1)),) if self.row.given else ()
        if observer is None:  # in the world it is the sensor that is measured: an antenna on its mast
            carried = lifted @ mount if self.sensor is not None and isinstance(lifted, Pose) else lifted
            return self.row.predict(Pose.identity(dim, (len(lifted),)), carried, self.dim, *given)
        found = self.row.predict(observer.lift(dim) @ mount, lifted, self.dim, *given)
        wanted = (len(lifted), self.values.shape[-1])
        if not self.row.native and not self.row.given and np.shape(found) != wanted:
            raise ModelError(
                f"{self.source} ({self.model}): what is predicted should have shape {wanted}, a row for each sighting "
                f"and a number for each one measured; found {np.shape(found)}"
            )
        return found

    def predict(self, values: Values) -> Array:
        """What should have been measured, h (m, size), were `values` the truth (in the frame of `values`)."""
        return self.predict_from(*self.ends(values))

    def residual(self, values: Values) -> Array:
        """e = z (-) h (m, rows), in the measurement's own units."""
        return self.row.minus(self.values, self.predict(values), self.dim)

    def whitened(self, values: Values) -> Array:
        """W e (m, rows), in sigmas."""
        return np.asarray((self.whitening @ self.residual(values)[..., None])[..., 0])

    def cost(self, values: Values) -> float:
        """What its rows cost at `values`, as its loss counts them; nothing where there are none."""
        return float(self.loss.cost(np.sum(self.whitened(values) ** 2, -1)).sum()) if len(self) else 0.0

    @property
    def observes_robots(self) -> bool:
        """True where another robot is the target of every row."""
        targets = self.keys[:, -1]
        return bool(len(targets) and (is_pose(targets) & (robot_of(targets) != self.robot)).all())


def told_by(tables: Iterable[Table], layout: Layout) -> list[Table]:
    """The rows that some variables can tell, of the tables that have any."""
    told = [table.select(table.told_by(layout)) for table in tables]
    return [table for table in told if len(table)]


def _marks_all(index: object, rows: int) -> bool:
    """Whether an index is a mask with all of so many rows."""
    return isinstance(index, np.ndarray) and index.dtype == np.bool_ and index.shape == (rows,) and bool(index.all())
