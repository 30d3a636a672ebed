"""What a team's sensors could see: each as a kind of sighting, no farther and no wider than it has seen already; a
sighting that next to nothing is given on, since it fits nothing, shows neither."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, lift_points
from teamslam.model import SQUARED, Kind, Table, Values, is_landmark, is_pose, robot_of

SLACK = 1.0 + 1e-9
WRONG = 0.1  # of the weight of a sighting: with less it is of something else than it says


@dataclass(frozen=True, eq=False)
class Eye:
    """One sensor of one robot: `like` is a row of its kind, with its usual noise; `sees_robots` or landmarks; up to
    `reach` [m] from the sensor, and where the cosine of the angle from its forward axis is at least `cosine`."""

    like: Table
    sees_robots: bool
    reach: float
    cosine: float

    @property
    def robot(self) -> int:
        """Whose it is."""
        return self.like.robot

    def sightings(self, keys: IntArray, values: Values) -> Table:
        """The sightings `keys` (m, 2) as it would make them without noise, of what it can see of them."""
        blank = np.zeros((len(keys), self.like.values.shape[1]))
        table = replace(self.like, keys=keys, values=blank, ids=np.arange(len(keys)))
        table = table.select(np.flatnonzero(_can_name(table, values)))
        table = table.select(np.flatnonzero(self.in_view(table, values)))
        return replace(table, values=table.predict(values))

    def in_view(self, table: Table, values: Values) -> BoolArray:
        """Which sightings (m,) it could make."""
        seen = _seen(table, values)
        distance = np.linalg.norm(seen, axis=-1)
        ahead = seen[:, 0] >= self.cosine * distance - 1e-9 * self.reach
        return np.asarray((distance > 0.0) & (distance <= self.reach * SLACK) & ahead)


def eyes_of(tables: Sequence[Table], values: Values) -> list[Eye]:
    """The sensors that a team has used to see landmarks and each other, one for each robot and kind of rows."""
    found: dict[tuple[int, tuple[str, str, int], bool], list[Eye]] = {}
    for table in tables:
        for sees_robots, rows in _kinds_of_rows(table):
            eye = _eye(table.select(rows), sees_robots, values)
            found.setdefault((table.robot, table.kind, sees_robots), []).append(eye)
    return [max(eyes, key=lambda eye: eye.reach) for eyes in found.values()]


def _kinds_of_rows(table: Table) -> Iterator[tuple[bool, IntArray]]:
    if table.row.unary:
        return
    target, own = table.keys[:, 1], robot_of(table.keys[:, 0]) == table.robot
    other = own & is_pose(target) & (robot_of(target) != table.robot)
    for sees_robots, rows in ((False, own & is_landmark(target)), (True, other)):
        if rows.any():
            yield sees_robots, np.flatnonzero(rows)


def _eye(table: Table, sees_robots: bool, values: Values) -> Eye:
    weight = table.loss.weight(np.sum(table.whitened(values) ** 2, -1))
    table = table.select(np.flatnonzero(weight > WRONG)) if (weight > WRONG).any() else table
    seen = _seen(table, values)
    distance = np.linalg.norm(seen, axis=-1)
    away = distance > 0.0
    cosine = float((seen[away, 0] / distance[away]).min(initial=1.0))
    information = np.sum(np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:])) ** 2, (1, 2))
    usual = int(np.argsort(information, kind="stable")[(len(table) - 1) // 2])
    like = replace(table.select(np.array([usual])), loss=SQUARED)
    return Eye(like, sees_robots, float(distance.max(initial=0.0)), cosine)


def _can_name(table: Table, values: Values) -> BoolArray:
    """Whether rows (m,) may be of what they name: those of the plane see no pose in space and measure none from it, and
    those that tell how a target is turned are of none that is but a point."""
    kinds = values.layout.kinds[values.layout.index(table.keys)]
    in_space = kinds == Kind.POSE3
    in_space[:, 0] &= table.row.targets_pose
    of_points = (kinds[:, -1] > Kind.POSE3) & table.sees_turns
    return np.asarray(((table.dim == 3) | ~in_space.any(1)) & ~of_points)


def _seen(table: Table, values: Values) -> Array:
    """Where the targets are (m, d), from the sensor."""
    observer, target = table.ends(values)
    assert observer is not None
    place = target.translation if isinstance(target, Pose) else target
    dim = max(observer.dim, place.shape[-1], 2 if table.sensor is None else table.sensor.dim)
    eye = observer.lift(dim) @ (Pose.identity(dim) if table.sensor is None else table.sensor.lift(dim))
    return eye.unact(lift_points(place, dim))
