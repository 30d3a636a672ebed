"""Whether numbers that came from elsewhere mean something, before anything is computed from them.

One submap that makes no sense must not cost a team its join. So what a join would stumble over is refused where it
comes in, with the reason: rotations and directions that are none, noise without a covariance, keys and robots that
cannot be, and numbers whose squares would overflow.
"""

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import AnyArray, Array, Pose
from teamslam.model import Kind, Submap, Table, is_landmark, ranks, robot_of, unpack
from teamslam.model.keys import MAX_ROBOT

LARGEST = 1e60  # its fourth power is still a number
ESTIMATED, MEASURED = 1e-8, 1e-5  # how far from orthonormal rotations may be; the kernel takes what is measured so

RAYS = {"bearing": slice(0, 3), "range_bearing": slice(1, 4), "corners": slice(0, 12)}
"""Which numbers of a measurement in space are unit vectors."""


def check_numbers(numbers: AnyArray, field: str) -> None:
    """Raise InputError where a number is not finite, or too large to be computed with."""
    if not (np.abs(numbers) <= LARGEST).all():
        raise InputError(f"a number is not finite, or beyond {LARGEST:g}", field=field)


def check_keys(keys: AnyArray) -> None:
    """Raise InputError where a key names no variable."""
    if keys.size and (keys.min() < 0 or robot_of(keys).max() > MAX_ROBOT):
        raise InputError("a key is neither a robot's pose nor a landmark", field="keys")


def check_rotations(poses: Pose, field: str = "state", tolerance: float = ESTIMATED) -> None:
    """Raise InputError where a rotation is none."""
    r = poses.rotation
    lopsided = np.abs(r @ np.swapaxes(r, -1, -2) - np.eye(poses.dim)).max(initial=0.0)
    if not lopsided < tolerance or (np.linalg.det(r) < 0.0).any():
        raise InputError("a rotation matrix is not orthonormal", field=field)


def check_table(table: Table) -> None:
    """Raise InputError where measurements make no sense on their own, whatever they will be joined with."""
    if not 1 <= table.robot <= MAX_ROBOT:
        raise InputError(f"robots are numbered from 1 to {MAX_ROBOT}, found {table.robot}", field="robot")
    check_keys(table.keys)
    if len(table.ids) and table.ids.min() < 0:
        raise InputError(f"rows of a log are counted from 0, found {table.ids.min()}", field="ids")
    if not table.row.unary and (robot_of(table.keys[:, 0]) != table.robot).any():
        raise InputError(f"the {table.source} of robot {table.robot} were not taken from its own poses", field="keys")
    if (table.keys[:, 0] == table.keys[:, -1]).any() and not table.row.unary:
        raise InputError(f"in the {table.source} a pose sees itself", field="keys")
    if table.sensor is not None:
        check_rotations(table.sensor, "sensor")
    _check_measured(table)
    _check_whitening(table.whitening, table.source)


def check_raw(submap: Submap) -> None:
    """Raise InputError where a submap's raw measurements contradict the submap: rows that it does not own up to, which
    could be counted twice unseen, or the orientation of what it holds as a point."""
    layout = submap.values.layout
    points = layout.keys[layout.kinds >= Kind.POINT2]
    for table in submap.raw:
        owned = submap.sources.rows_of(table)
        if not owned.all():
            raise InputError(
                f"its raw {table.source} hold row {table.ids[~owned][0]} of robot {table.robot}, which is not among "
                f"its sources: it could be counted twice unseen",
                field="sources",
            )
        targets = table.keys[:, -1]
        if table.row.targets_pose and np.isin(targets[is_landmark(targets)], points).any():
            raise InputError(f"its raw {table.source} turn a landmark that it holds as a point", field="raw keys")


def _check_measured(table: Table) -> None:
    check_numbers(table.values, f"{table.source} values")
    if table.row.measures_pose:
        measured = unpack(table.values, Kind(table.dim - 2))
        assert isinstance(measured, Pose)
        check_rotations(measured, f"{table.source} values", MEASURED)
    elif table.dim == 3 and (rays := RAYS.get(table.model)):
        length = np.linalg.norm(table.values[:, rays].reshape(-1, 3), axis=-1)
        if (np.abs(length - 1.0) > 0.5 * MEASURED).any():
            raise InputError("a direction in space is no unit vector", field=f"{table.source} values")


def _check_whitening(whitening: Array, source: str) -> None:
    """The rows of W that are not zero must be independent, judged as correlations so that units do not matter: a
    measurement may leave a direction open, but then says so."""
    check_numbers(whitening, f"{source} whitening")
    information = np.swapaxes(whitening, -1, -2) @ whitening
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    if not (ranks(whitening) > 0).all() or not ((scale > 1.0 / LARGEST) | (scale == 0.0)).all():
        raise InputError("a measurement says nothing", field=f"{source} whitening")
    divisor = np.where(scale > 0.0, scale, 1.0)
    correlation = information / (divisor[:, :, None] * divisor[:, None, :])
    independent = (np.linalg.eigvalsh(correlation) > 1e-14).sum(-1)
    if (independent < ranks(whitening)).any():
        raise InputError("the noise of a measurement has no covariance", field=f"{source} whitening")
