"""MODELS: what sensors report, by name. Adding a sensor is adding a row.

A row predicts the measurement h from the observer's pose and the target, and says how two measurements differ, so that
every residual is e = z (-) h. The observer is the sensor: body pose @ sensor pose. Everything else (Jacobians, robust
losses, simulation, start values) follows from these two functions; the built-in rows also run natively in the kernel.

| model         | keys            | a measurement z                                    | residual              |
|---------------|-----------------|----------------------------------------------------|-----------------------|
| relative_pose | pose, pose      | T (d), R row-major (d*d) of target in observer     | [zT - hT; Log(hR'zR)] |
| point         | pose, any       | position (d) of the target in the observer's frame | z - h                 |
| range         | pose, any       | distance (1)                                       | z - h                 |
| bearing       | pose, any       | plane: angle (1); space: unit vector (3)           | wrapped; sphere's Log |
| range_bearing | pose, any       | range, then bearing                                | both                  |
| position      | any             | position (d) in the world frame                    | z - h                 |
| pose          | pose            | pose in the world frame, as relative_pose          | as relative_pose      |
| corners       | pose, pose      | space: 4 unit vectors (12) to points of the target | sphere's Log of each  |
|               |                 | that are given (12), in the target's own frame     |                       |

Equations (3)-(5) of the paper with the corrections of the theory page: R is transposed, the rotation enters as the
vector Log and with the sign of z (-) h. "any" is a landmark or a robot's pose, whose position is meant.

The corners of a tag are a measurement of its own: what a camera sees are four directions, and a pose made of them is no
Gaussian where a tag is small or seen from the front. Where its corners are in the body that carries it is given, and
stands in each row: so tags of all sizes, and all faces of a cube, are rows of one table.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose, directions, rotations
from teamslam.model.values import pack

Target = Pose | Array


def _add(h: Array, n: Array, dim: int) -> Array:
    return h + n


@dataclass(frozen=True)
class Model:
    """One row of MODELS.

    `predict(observer, target)` gives h (m, size) from Poses (m,) and Poses or points; `minus(z, h)` gives e (m, rows).
    `size` and `rows` are indexed by the dimension 2 or 3 of the measurement. `unary` models have no observer but the
    world (the predicted pose or position is that of the target). `native` is the kernel's name for it, if it has one.
    `parts` names the rows of a residual in the plane and in space. Of a measurement's numbers the last `given` are not
    measured but known of what is seen: `predict` then takes them (m, given) after the dimension, and returns them as
    they are. A model of size 0 is not measured in that dimension. `plus(h, n)` gives z with z (-) h = n.
    """

    predict: Callable[..., Array]
    minus: Callable[[Array, Array, int], Array]
    size: tuple[int, int]
    rows: tuple[int, int]
    unary: bool = False
    targets_pose: bool = False
    native: bool = False
    parts: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    plus: Callable[[Array, Array, int], Array] = _add
    given: int = 0

    @property
    def measures_pose(self) -> bool:
        """Whether a measurement is itself a pose: T, then R row by row."""
        return self.targets_pose and not self.given

    def z_size(self, dim: int) -> int:
        """Numbers in one measurement of dimension 2 or 3."""
        return self.size[dim - 2]

    def residual_rows(self, dim: int) -> int:
        """Rows in one residual of dimension 2 or 3."""
        return self.rows[dim - 2]

    def part_names(self, dim: int) -> tuple[str, ...]:
        """What the rows of a residual are called: 'x', 'bearing', ...; by number where nobody named them."""
        return self.parts[dim - 2] or tuple(str(n + 1) for n in range(self.residual_rows(dim)))


def position(target: Target, dim: int) -> Array:
    """Where a target is, (m, dim): a point, or the place of a pose."""
    return (target.translation if isinstance(target, Pose) else target)[..., :dim]


def pose_of(z: Array, dim: int) -> Pose:
    """A measured pose (m, size) as a Pose."""
    return Pose(z[..., dim:].reshape(*z.shape[:-1], dim, dim), z[..., :dim])


def _relative_pose(observer: Pose, target: Target, dim: int) -> Array:
    assert isinstance(target, Pose)
    return pack(observer.between(target))


def _minus_pose(z: Array, h: Array, dim: int) -> Array:
    return pose_of(z, dim).minus(pose_of(h, dim))


def _point(observer: Pose, target: Target, dim: int) -> Array:
    full = observer.dim
    return np.asarray(observer.unact(position(target, full))[..., :dim])


def _range(observer: Pose, target: Target, dim: int) -> Array:
    return np.asarray(np.linalg.norm(_point(observer, target, dim), axis=-1, keepdims=True))


def _bearing(observer: Pose, target: Target, dim: int) -> Array:
    return np.asarray(directions(dim).of(_point(observer, target, dim)))


def _minus_bearing(z: Array, h: Array, dim: int) -> Array:
    return np.asarray(directions(dim).minus(z, h))


def _range_bearing(observer: Pose, target: Target, dim: int) -> Array:
    return np.concatenate([_range(observer, target, dim), _bearing(observer, target, dim)], -1)


def _minus_range_bearing(z: Array, h: Array, dim: int) -> Array:
    return np.concatenate([z[..., :1] - h[..., :1], _minus_bearing(z[..., 1:], h[..., 1:], dim)], -1)


def _plus_pose(h: Array, n: Array, dim: int) -> Array:
    pose = pose_of(h, dim)
    return pack(Pose(pose.rotation @ rotations(dim).exp(n[..., dim:]), pose.translation + n[..., :dim]))


def _plus_bearing(h: Array, n: Array, dim: int) -> Array:
    return np.asarray(directions(dim).plus(h, n))


def _plus_corners(h: Array, n: Array, dim: int) -> Array:
    rays = directions(dim).plus(h[:, :12].reshape(-1, 3), n.reshape(-1, 2))
    return np.concatenate([rays.reshape(-1, 12), h[:, 12:]], -1)


def _plus_range_bearing(h: Array, n: Array, dim: int) -> Array:
    return np.concatenate([h[..., :1] + n[..., :1], _plus_bearing(h[..., 1:], n[..., 1:], dim)], -1)


def _difference(z: Array, h: Array, dim: int) -> Array:
    return z - h


def _position(observer: Pose, target: Target, dim: int) -> Array:
    return position(target, dim)


def _pose(observer: Pose, target: Target, dim: int) -> Array:
    assert isinstance(target, Pose)
    return pack(target.lift(dim))


def _corners(observer: Pose, target: Target, dim: int, places: Array) -> Array:
    assert isinstance(target, Pose)
    pose, points = observer.between(target), places.reshape(*places.shape[:-1], 4, 3)
    seen = points @ np.swapaxes(pose.rotation, -1, -2) + pose.translation[..., None, :]
    rays = directions(dim).of(seen)
    return np.concatenate([rays.reshape(*rays.shape[:-2], 12), places], -1)


def _minus_corners(z: Array, h: Array, dim: int) -> Array:
    one, other = (numbers[..., :12].reshape(*numbers.shape[:-1], 4, 3) for numbers in (z, h))
    off = directions(dim).minus(one, other)
    return np.asarray(off.reshape(*off.shape[:-2], 8))


PLACE = (("x", "y"), ("x", "y", "z"))
POSE = (("x", "y", "theta"), ("x", "y", "z", "rx", "ry", "rz"))  # of a rotation in space: about the body's axes
DISTANCE = (("range",), ("range",))
DIRECTION = (("bearing",), ("azimuth", "elevation"))
OF_CORNERS = ((), tuple(f"{angle}_{corner}" for corner in "1234" for angle in ("azimuth", "elevation")))
BOTH = (("range", "bearing"), ("range", "azimuth", "elevation"))

MODELS: dict[str, Model] = {
    "relative_pose": Model(
        _relative_pose, _minus_pose, (6, 12), (3, 6), targets_pose=True, native=True, parts=POSE, plus=_plus_pose
    ),
    "point": Model(_point, _difference, (2, 3), (2, 3), native=True, parts=PLACE),
    "range": Model(_range, _difference, (1, 1), (1, 1), native=True, parts=DISTANCE),
    "bearing": Model(_bearing, _minus_bearing, (1, 3), (1, 2), native=True, parts=DIRECTION, plus=_plus_bearing),
    "range_bearing": Model(
        _range_bearing, _minus_range_bearing, (2, 4), (2, 3), native=True, parts=BOTH, plus=_plus_range_bearing
    ),
    "position": Model(_position, _difference, (2, 3), (2, 3), unary=True, native=True, parts=PLACE),
    "pose": Model(
        _pose, _minus_pose, (6, 12), (3, 6), unary=True, targets_pose=True, native=True, parts=POSE, plus=_plus_pose
    ),
    "corners": Model(
        _corners,
        _minus_corners,
        (0, 24),
        (0, 8),
        targets_pose=True,
        native=True,
        parts=OF_CORNERS,
        given=12,
        plus=_plus_corners,
    ),
}
