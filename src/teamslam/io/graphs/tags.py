"""Tags: the first word of a line of a graph file, and what the words after it mean. What formats of lines share.

A measurement's line is: tag, ids, perhaps a sensor's id, the measured value, the noise.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose, rotations
from teamslam.io.files.records import EULER, QUATERNION, XYTHETA, Records, triangle
from teamslam.model import MODELS, Kind, pack


@dataclass(frozen=True)
class Form:
    """How a value stands in a line: the names of its numbers, and how they become rows (n, size) as MODELS or the state
    vector have them."""

    names: tuple[str, ...]
    rows: Callable[[Records, int], Array]


@dataclass(frozen=True)
class Tag:
    """One kind of measurement: its model and dimension, the kinds of its variables, the form of its value, and whether
    the id of a sensor may stand before the value."""

    model: str
    dim: int
    ends: tuple[Kind, ...]
    form: str
    parameter: bool = False

    @property
    def numbers(self) -> int:
        """Numbers in the value."""
        return len(FORMS[self.form].names)

    @property
    def rows(self) -> int:
        """Rows of the residual."""
        return MODELS[self.model].residual_rows(self.dim)

    def line(self, name: str, *, noise: str | None = None) -> str:
        """A good line, for messages."""
        ids = " ".join(["id"] * len(self.ends)) + (" parameter" if self.parameter else "")
        noise = noise or f"upper triangle of the information ({triangle(self.rows)} numbers)"
        return f"{name} {ids} {' '.join(FORMS[self.form].names)} {noise}"


def _euler(records: Records, start: int) -> Array:
    """Poses in space from x y z roll pitch yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    return pack(euler_pose(records.floats(start, EULER)))


def euler_pose(numbers: Array) -> Pose:
    """Poses (n,) from (n, 6): x y z [m], roll pitch yaw [rad]."""
    turn = rotations(3)
    zero = np.zeros(len(numbers))
    roll, pitch, yaw = numbers[:, 3:].T
    about_x, about_y, about_z = (
        turn.exp(np.stack(w, -1)) for w in ((roll, zero, zero), (zero, pitch, zero), (zero, zero, yaw))
    )
    return Pose(np.asarray(about_z @ about_y @ about_x), numbers[:, :3].copy())


def _range_bearing(records: Records, start: int) -> Array:
    numbers = records.floats(start, ("bearing", "range"))
    records.refuse(numbers[:, 1] < 0.0, f"a range is not negative, found {{{start + 1}}}", "range")
    return numbers[:, ::-1].copy()


def _plain(*names: str) -> Form:
    return Form(names, lambda records, start: records.floats(start, names))


FORMS: dict[str, Form] = {
    "xytheta": Form(XYTHETA, lambda records, start: pack(records.poses(start, 2))),
    "quaternion": Form(QUATERNION, lambda records, start: pack(records.poses(start, 3))),
    "euler": Form(EULER, _euler),
    "xy": _plain("x", "y"),
    "xyz": _plain("x", "y", "z"),
    "bearing": _plain("bearing"),
    "bearing range": Form(("bearing", "range"), _range_bearing),
}
