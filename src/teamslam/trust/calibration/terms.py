"""TERMS: systematic errors that sensors have, by name. Adding one is adding a row.

A term says how a measurement errs in proportion to one unknown p, the same for all rows of a table:

    z = h (+) p effect(h) (+) noise

The effect is taken at the prediction h, never at the measured z: noise of z times itself would add up to a bias.

| term           | of                 | p                                              | first guess of its size       |
|----------------|--------------------|------------------------------------------------|-------------------------------|
| scale          | odometry           | share by which steps are too long              | 0.05                          |
| turn scale     | odometry           | share by which turns are too large             | 0.05                          |
| turn drift     | odometry, plane    | turn that is not there [rad/s] (or a step)     | 0.05 of the turns' rms        |
| range scale    | ranges and points  | share by which distances are too long          | 0.05                          |
| range offset   | ranges and points  | length added to every distance [m]             | 0.05 of the ranges' rms       |
| landmark offset| bare ranges        | length added to those of one landmark [m]      | 0.05 of the ranges' rms       |
| depth          | range and bearing  | 1: depth r cos b is measured, not distance     | 1                             |
| bearing offset | bearings, points   | angle added to every bearing [rad]             | 0.05                          |
| delay          | sightings          | how long before its stamp it was taken [s]     | 0.1                           |

Ranges are the measure of a map: what lengthens all ranges of all robots alike, nobody sees. So offset and `depth` are
taken beside the scale (of 1 and of r (cos b - 1), what is in proportion to r is left out), and of the scales of a team
only how they differ is evidence (`relative`); odometry's scale is then seen against ranges (`choice`). What the scales
have in common stays uncertain by as much as they differ, divided by the root of their number.

A term `of_each` landmark is as many unknowns as a table has landmarks: a radio whose signal comes by way of a wall, or
whose antenna delays it, is farther away for all who range it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose, directions
from teamslam.model import Table, Values, is_landmark
from teamslam.model.sensors import pose_of

SHARE = 0.05
MOST, FEWEST = 30, 5  # landmarks with an error of their own; sightings of one
RANGES, BEARINGS = ("range", "range_bearing", "point", "relative_pose"), ("bearing", "range_bearing", "point")


@dataclass(frozen=True, eq=False)
class Scene:
    """The rows of a table at a map: `predicted` h (m, size), `lasting` (m,) time between the ends of a row [s], and
    `rate` (m, rows), how residuals change with the time at which the rows were taken."""

    table: Table
    predicted: Array
    lasting: Array
    rate: Array

    @property
    def own(self) -> bool:
        """Whether it is the robot's own motion that is measured."""
        return self.table.is_odometry

    @property
    def sees(self) -> bool:
        """Whether a target is measured from an observer."""
        return not self.own and not self.table.row.unary and self.table.row.native

    @property
    def offset(self) -> Array:
        """Where targets are predicted in the sensor's frame (m, dim)."""
        return self.predicted[:, : self.table.dim]

    @property
    def distance(self) -> Array:
        """How far away targets are predicted (m,)."""
        ranged = self.table.model in ("range", "range_bearing")
        return self.predicted[:, 0] if ranged else np.linalg.norm(self.offset, axis=-1)


@dataclass(frozen=True)
class Term:
    """A row of TERMS: `effect` (m, rows) of one unit of p, None where it makes no sense for a table; `size`, a first
    guess of how large p is; `relative`: only how the team's differ is seen; `of_each`: each landmark has its own."""

    name: str
    unit: str
    effect: Callable[[Scene], Array | None]
    size: Callable[[Scene], float]
    relative: bool = False
    of_each: bool = False


def _step(scene: Scene) -> Array | None:
    return _columns(scene, slice(0, scene.table.dim), scene.offset) if scene.own else None


def _turn(scene: Scene) -> Array | None:
    return _columns(scene, slice(scene.table.dim, None), _turns(scene)) if scene.own else None


def _drift(scene: Scene) -> Array | None:
    return _columns(scene, slice(2, 3), scene.lasting[:, None]) if scene.own and scene.table.dim == 2 else None


def _lengthened(scene: Scene) -> Array | None:
    return _along(scene, scene.distance)


def _longer(scene: Scene) -> Array | None:
    return _along(scene, _beside(scene.distance, np.ones(len(scene.table))))


def _longer_to_each(scene: Scene) -> Array | None:
    bare = scene.table.model == "range" and bool(is_landmark(scene.table.keys[:, -1]).all())
    return _along(scene, np.ones(len(scene.table))) if bare else None


def _depth(scene: Scene) -> Array | None:
    if scene.table.model != "range_bearing" or not scene.sees:
        return None
    ahead = directions(scene.table.dim).ray(scene.predicted[:, 1:])[:, 0]
    return _along(scene, _beside(scene.distance, scene.distance * (ahead - 1.0)))


def _turned(scene: Scene) -> Array | None:
    table = scene.table
    if not scene.sees or table.dim != 2 or table.model not in BEARINGS:
        return None
    if table.model == "point":
        return np.stack([-scene.offset[:, 1], scene.offset[:, 0]], -1)
    return _columns(scene, slice(table.row.residual_rows(2) - 1, None), np.ones((len(table), 1)))


def _late(scene: Scene) -> Array | None:
    return -scene.rate if scene.sees and scene.rate.any() else None


def _beside(known: Array, effect: Array) -> Array:
    """An effect (m,) without what is in proportion to a known one."""
    return np.asarray(effect - float(effect @ known) / max(float(known @ known), 1e-300) * known)


def _along(scene: Scene, length: Array) -> Array | None:
    """Distances that are longer by `length` (m,)."""
    if not scene.sees or scene.table.model not in RANGES:
        return None
    if scene.table.model in ("range", "range_bearing"):
        return _columns(scene, slice(0, 1), length[:, None])
    away = scene.offset / np.maximum(scene.distance, 1e-12)[:, None]
    return _columns(scene, slice(0, scene.table.dim), away * length[:, None])


def _columns(scene: Scene, where: slice, numbers: Array) -> Array:
    out = np.zeros((len(scene.table), scene.table.row.residual_rows(scene.table.dim)))
    out[:, where] = numbers
    return out


def _turns(scene: Scene) -> Array:
    """Turns of a relative pose, (m, angles)."""
    turned: Pose = pose_of(scene.predicted, scene.table.dim)
    return turned.minus(Pose.identity(turned.dim, turned.batch))[:, scene.table.dim :]


def _rms(numbers: Array) -> float:
    return float(np.sqrt(np.mean(np.square(numbers)))) if numbers.size else 0.0


def _share(scene: Scene) -> float:
    return SHARE


TERMS: tuple[Term, ...] = (
    Term("scale", "", _step, _share),
    Term("turn scale", "", _turn, _share),
    Term("turn drift", "rad/s", _drift, lambda scene: SHARE * _rms(_turns(scene)) / max(_rms(scene.lasting), 1e-12)),
    Term("range scale", "", _lengthened, _share, relative=True),
    Term("range offset", "m", _longer, lambda scene: SHARE * _rms(scene.distance)),
    Term("landmark offset", "m", _longer_to_each, lambda scene: SHARE * _rms(scene.distance), of_each=True),
    Term("depth", "", _depth, lambda scene: 1.0),
    Term("bearing offset", "rad", _turned, _share),
    Term("delay", "s", _late, lambda scene: 0.1),
)


def effects_of(scene: Scene) -> Iterator[tuple[Term, int, Array]]:
    """The systematic errors that a table may have: each with the landmark that it is of, 0 where it is of all, and what
    one unit of it does to the rows (m, rows). Of more than MOST landmarks none is told from the others."""
    for term in TERMS:
        effect = term.effect(scene)
        if effect is None or not effect.any():
            continue
        if not term.of_each:
            yield term, 0, effect
            continue
        targets = scene.table.keys[:, -1]
        marks, counts = np.unique(targets, return_counts=True)
        if len(marks) <= MOST:
            for mark in marks[counts >= FEWEST].tolist():
                yield term, mark, effect * (targets == mark)[:, None]


def scene_of(table: Table, values: Values, lasting: Array, rate: Array) -> Scene:
    """The rows of a table at an estimate."""
    return Scene(table, table.predict(values), lasting, rate)
