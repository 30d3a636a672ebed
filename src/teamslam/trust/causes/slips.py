"""SLIPS that people make in tables of measurements, and how each is undone.

Lengths may be in another unit, angles in degrees, positions in other axes (a camera's, a compass's, left-handed ones),
turns of the wrong sign, poses the wrong way round. An undone table holds what was meant if the slip was made.

Which slip fits best is a matter of likelihood. If numbers z are the truth with noise after a change of unit f, then
-2 log p(z) = cost(f z) - 2 n log f for n numbers: without the last term, `unit`, a log whose lengths were all made
tiny would fit best.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import permutations, product

import numpy as np

from teamslam.geometry import Array, Pose, directions
from teamslam.model import MODELS, Table, pack
from teamslam.model.sensors import pose_of

UNITS = {"millimetres": 1e-3, "centimetres": 1e-2, "feet": 0.3048}
"""What lengths that were written in one of these are to be multiplied with. Nobody measures rooms in kilometres:
lengths that look like them stand beside others in millimetres."""


@dataclass(frozen=True, eq=False)
class Slip:
    """One slip: its `kind`, its `name`, which is the same in the plane and in space, what a table `looks` like with it,
    in words, and how its values (m, size) are put right.

    `unit` is log f of all numbers of a row together; `sigma`, by how much the standard deviations of each number are to
    be multiplied, where they were written in another unit too; `changes`, how much is changed: of two slips that fit
    alike, the lesser is meant; `of_eyes`: of what a robot sees alone, and not of its odometry.
    """

    kind: str
    name: str
    looks: str
    undo: Callable[[Array], Array]
    unit: float = 0.0
    changes: int = 1
    sigma: tuple[float, ...] = ()
    of_eyes: bool = False

    @property
    def written(self) -> float:
        """log f of all numbers of a row, whether their standard deviations were written in it or not."""
        return self.unit + float(np.sum(np.log(self.sigma or 1.0)))

    def undone(self, table: Table) -> Table:
        """The table without it."""
        if not self.sigma:
            return replace(table, values=self.undo(table.values))
        return replace(table, values=self.undo(table.values), whitening=table.whitening / np.array(self.sigma))


TOO = "too"
"""What the name of a unit ends with where the standard deviations are in it as well."""

MIRRORED = "axes x -y z"
"""The name of the slip that exchanges left and right in all."""


@dataclass(frozen=True)
class Measure:
    """One row of MEASURES: what the values (m, size) of a model are.

    `lengths(dim)`: how many of the numbers, from the first, are lengths. `in_axes(Q, dim, z)`: the same seen in axes
    turned (or mirrored) by Q. `angle`: the last number is an angle, in the plane. `poses`: values are poses.
    """

    lengths: Callable[[int], int]
    in_axes: Callable[[Array, int, Array], Array] | None = None
    angle: bool = False
    poses: bool = False


@cache
def slips(model: str, dim: int) -> tuple[Slip, ...]:
    """All that a table of a model may hold; nothing of sensors that people added."""
    return tuple(_slips(model, MEASURES[model], dim)) if model in MEASURES else ()


def without(table: Table, name: str) -> Table:
    """A table without the slip of a name; as it is where it cannot hold it."""
    return next((slip.undone(table) for slip in slips(table.model, table.dim) if slip.name == name), table)


def written(table: Table, name: str) -> float:
    """log f of all numbers of a row of a table, if it holds the slip of a name."""
    return next((slip.written for slip in slips(table.model, table.dim) if slip.name == name), 0.0)


def _slips(model: str, measure: Measure, dim: int) -> Iterator[Slip]:
    if measure.angle and dim == 2:
        unit = float(np.log(np.pi / 180.0))
        yield Slip("degrees", "degrees", "angles are in degrees", _in_radians, unit)
    if count := measure.lengths(dim):
        for name, factor in UNITS.items():
            undo, unit = partial(_longer, factor, count), count * float(np.log(factor))
            yield Slip("unit", name, f"lengths are in {name}", undo, unit)
            sigma = tuple(factor if n < count else 1.0 for n in range(MODELS[model].residual_rows(dim)))
            yield Slip("unit", f"{name} {TOO}", f"lengths are in {name}", undo, sigma=sigma)
    if measure.in_axes is not None:
        for axes in every_axes(dim):
            kind, looks = _axes_in_words(axes, measure)
            undo = partial(measure.in_axes, axes, dim)
            yield Slip(kind, f"axes {_signature(axes)}", looks, undo, changes=_changed(axes))
    if measure.poses:
        yield Slip("direction", "inverse", "poses are the wrong way round", partial(_inverse, dim))
        yield from _slips_of_mounts(dim)
        yield from _slips_of_turns(dim)


def _slips_of_turns(dim: int) -> Iterator[Slip]:
    """Turns of the wrong sign, and places in other axes than turns."""
    if dim > 2:
        yield Slip("sign", "turned back", TURNS, partial(_turned_back, dim))
    for axes in every_axes(dim):
        if _changed(axes) == 1 and (dim > 2 or axes[1, 1] < 0.0):
            about = " and ".join(name for name, row in zip("xyz", axes, strict=False) if row.sum() > 0)
            looks = TURNS if dim == 2 else f"turns about {about} have the wrong sign"
            yield Slip("sign", f"turns {_signature(axes)}", looks, partial(_turned_in_axes, axes, dim))
        looks = f"places are in other axes than turns: they fit as {_read_as(axes)}"
        undo = partial(_placed_in_axes, axes, dim)
        yield Slip("axes", f"places {_signature(axes)}", looks, undo, changes=1 + _changed(axes))


def _slips_of_mounts(dim: int) -> Iterator[Slip]:
    """A sensor that is turned on its robot by quarter turns, while what it sees has axes of its own."""
    for axes in every_axes(dim):
        if np.linalg.det(axes) > 0.0:
            looks = f"their sensor is turned on its robot: they fit, places and turns, as {_read_as(axes)}"
            name = f"seen {_signature(axes)}"
            yield Slip(
                "direction", name, looks, partial(_seen_in_axes, axes, dim), changes=_changed(axes), of_eyes=True
            )


TURNS = "turns have the wrong sign"


# --- values -----------------------------------------------------------------------------------------------------------


def every_axes(dim: int) -> Iterator[Array]:
    """All matrices that exchange axes or their signs, the unit matrix left out."""
    for order in permutations(range(dim)):
        for signs in product((1.0, -1.0), repeat=dim):
            axes = np.array(signs)[:, None] * np.eye(dim)[list(order)]
            if _changed(axes):
                yield axes


def _changed(axes: Array) -> int:
    """How many axes are not as they were."""
    return int((axes != np.eye(len(axes))).any(-1).sum())


def _longer(factor: float, count: int, z: Array) -> Array:
    return z * np.where(np.arange(z.shape[-1]) < count, factor, 1.0)


def _in_radians(z: Array) -> Array:
    return np.concatenate([z[:, :-1], np.deg2rad(z[:, -1:])], -1)


def _inverse(dim: int, z: Array) -> Array:
    return pack(pose_of(z, dim).inverse())


def _turned_back(dim: int, z: Array) -> Array:
    pose = pose_of(z, dim)
    return pack(Pose(np.swapaxes(pose.rotation, -1, -2), pose.translation))


def _turned_in_axes(axes: Array, dim: int, z: Array) -> Array:
    pose = pose_of(z, dim)
    return pack(Pose(axes @ pose.rotation @ axes.T, pose.translation))


def _placed_in_axes(axes: Array, dim: int, z: Array) -> Array:
    pose = pose_of(z, dim)
    return pack(Pose(pose.rotation, pose.translation @ axes.T))


def _seen_in_axes(axes: Array, dim: int, z: Array) -> Array:
    """One end of a pose, that which looks, is written in other axes."""
    pose = pose_of(z, dim)
    return pack(Pose(axes @ pose.rotation, pose.translation @ axes.T))


def _pose_in_axes(axes: Array, dim: int, z: Array) -> Array:
    """Both ends of a pose are written in other axes."""
    return _placed_in_axes(axes, dim, _turned_in_axes(axes, dim, z))


def _point_in_axes(axes: Array, dim: int, z: Array) -> Array:
    return np.asarray(z @ axes.T)


def _bearing_in_axes(axes: Array, dim: int, z: Array) -> Array:
    return np.asarray(directions(dim).of(directions(dim).ray(z) @ axes.T))


def _range_bearing_in_axes(axes: Array, dim: int, z: Array) -> Array:
    return np.concatenate([z[:, :1], _bearing_in_axes(axes, dim, z[:, 1:])], -1)


def _all(dim: int) -> int:
    return dim


def _one(dim: int) -> int:
    return 1


def _none(dim: int) -> int:
    return 0


MEASURES: dict[str, Measure] = {
    "relative_pose": Measure(_all, _pose_in_axes, poses=True),
    "point": Measure(_all, _point_in_axes),
    "range": Measure(_one),
    "bearing": Measure(_none, _bearing_in_axes, angle=True),
    "range_bearing": Measure(_one, _range_bearing_in_axes, angle=True),
}


# --- words ------------------------------------------------------------------------------------------------------------


def _axes_in_words(axes: Array, measure: Measure) -> tuple[str, str]:
    """The kind of slip, and what it looks like."""
    if measure.angle and len(axes) == 2:
        turn = int(np.rint(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))) % 360
        if np.linalg.det(axes) > 0.0:
            return "axes", f"bearings are off: they fit with {turn} degrees added"
        if turn == 0:
            return "sign", "bearings have the wrong sign"
        return "axes", f"bearings count from another axis the other way: they fit as {turn} degrees minus them"
    if _changed(axes) == 1:
        return "sign", f"{'xyz'[int(np.argmin(np.diag(axes)))]} has the wrong sign: they fit as {_read_as(axes)}"
    return "axes", f"axes are others: they fit as {_read_as(axes)}"


def _meant(axes: Array) -> list[str]:
    """What is meant in terms of what is written, axis by axis."""
    return [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in axes]


def _read_as(axes: Array) -> str:
    """'(y, x) where (x, y) is written'."""
    return f"({', '.join(_meant(axes))}) where ({', '.join('xyz'[: len(axes)])}) is written"


def _signature(axes: Array) -> str:
    """The same in the plane as in space: 'y x z'."""
    return " ".join([*_meant(axes), "z"][:3])
