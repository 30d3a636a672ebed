"""Which columns a sensor's rows have, and how they become rows of a table.

| model                | plane              | space                            |
|----------------------|--------------------|----------------------------------|
| relative_pose, pose  | x, y, theta        | x, y, z, qw, qx, qy, qz          |
| point, position      | x, y               | x, y, z                          |
| range                | range              | range (with dim = 3)             |
| bearing              | bearing            | azimuth, elevation               |
| range_bearing        | range, bearing     | range, azimuth, elevation        |
| corners              | -                  | azimuth_1, elevation_1 to _4,    |
|                      |                    | x_1, y_1, z_1 to _4              |

Angles in radians, anticlockwise; azimuth from x towards y, elevation from the xy plane towards z. Of corners x, y, z
are their places in the frame of what carries them, and known. The components of the noise are called by the columns;
those of a rotation in space rx, ry, rz (about the measured body's axes).
"""

from collections.abc import Callable

import numpy as np

from teamslam.errors import InputError, ModelError
from teamslam.geometry import Array, IntArray, Pose, directions
from teamslam.io.files.csv_file import Csv
from teamslam.model import MODELS, Kind, Table, pack, whitening, whitening_of_information
from teamslam.model.sensors import pose_of

POSE = {2: ("x", "y", "theta"), 3: ("x", "y", "z", "qw", "qx", "qy", "qz")}
POINT = {2: ("x", "y"), 3: ("x", "y", "z")}
ANGLES = {2: ("bearing",), 3: ("azimuth", "elevation")}
CORNERS = tuple(f"{name}_{corner}" for name in (*ANGLES[3], *POINT[3]) for corner in "1234")


def value_columns(model: str, dim: int) -> tuple[str, ...]:
    """The columns of a measurement."""
    if MODELS[model].measures_pose:
        return POSE[dim]
    return {"point": POINT[dim], "position": POINT[dim], "range": ("range",), "bearing": ANGLES[dim],
            "range_bearing": ("range", *ANGLES[dim]), "corners": CORNERS if dim == 3 else ()}[model]  # fmt: skip


def components(model: str, dim: int) -> tuple[str, ...]:
    """The names of a residual's rows, in their order."""
    return MODELS[model].part_names(dim)


def sigma_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of standard deviations."""
    return tuple(f"sigma_{name}" for name in names)


def covariance_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of a full covariance: its upper triangle, row by row."""
    return tuple(f"cov_{a}_{b}" for k, a in enumerate(names) for b in names[k:])


def information_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of full information, which may be zero in some directions: its upper triangle, row by row."""
    return tuple(f"inf_{a}_{b}" for k, a in enumerate(names) for b in names[k:])


def noise_columns(names: tuple[str, ...]) -> tuple[str, ...]:
    """All columns that may say how well a row is known."""
    return (*sigma_columns(names), *covariance_columns(names), *information_columns(names))


def dim_of(csv: Csv, model: str, stated: int | None, default: int) -> int:
    """The dimension of a file's measurements: told by its columns, else stated, else `default`.

    InputError where neither plane's nor space's columns are all there, or the columns contradict what is stated.
    """
    able = [dim for dim in (3, 2) if value_columns(model, dim)]
    fits = [dim for dim in able if csv.has(*value_columns(model, dim))]
    if not fits:
        plane, space = (", ".join(value_columns(model, dim)) for dim in (2, 3))
        shapes = space if plane == space or not plane else f"{plane} (plane) or {space} (space)"
        raise InputError(f"a {model} needs the columns {shapes}; found {', '.join(csv.columns)}", path=csv.path, line=1)
    if stated is not None and stated not in able:
        raise InputError(f"dim = {stated}, but {model} are measured in space", path=csv.path)
    if stated is not None and stated not in fits:
        missing = next(name for name in value_columns(model, stated) if not csv.has(name))
        raise InputError(f"dim = {stated}, but there is no such column", path=csv.path, line=1, field=missing)
    if stated is not None:
        return stated
    return default if len(fits) == 2 and value_columns(model, 2) == value_columns(model, 3) else fits[0]


def read_values(csv: Csv, model: str, dim: int) -> Array:
    """The measurements (m, size) as MODELS has them."""
    if MODELS[model].measures_pose:
        return pack(read_poses(csv, dim))
    numbers = csv.numbers(*value_columns(model, dim))
    if model in ("range", "range_bearing"):
        _check_ranges(csv, numbers[:, 0])
    if model == "corners":
        azimuth, elevation, *places = numbers.reshape(len(numbers), 5, 4).swapaxes(0, 1)
        rays = directions(3).of_angles(np.stack([azimuth, elevation], -1))
        return np.concatenate([rays.reshape(-1, 12), np.stack(places, -1).reshape(-1, 12)], 1)
    if dim == 3 and model in ("bearing", "range_bearing"):
        azimuth, elevation = numbers[:, -2], numbers[:, -1]
        flat = np.cos(elevation)
        unit = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], -1)
        return np.concatenate([numbers[:, :-2], unit], -1)
    return numbers


def notes_of_angles(csv: Csv, model: str, dim: int) -> list[str]:
    """Words on angles beyond a whole turn, which nobody measures in radians; none for absolute headings, which may
    count turns."""
    notes = []
    measured = () if MODELS[model].unary else value_columns(model, dim)
    for name in (name for name in ("theta", "bearing", "azimuth", "elevation") if name in measured):
        found = csv.numbers(name)[:, 0]
        beyond = np.flatnonzero(np.abs(found) > 2.0 * np.pi)
        if len(beyond):
            first = int(beyond[0])
            notes.append(
                f"{csv.path}, line {int(csv.lines[first])}, field '{name}': found {found[first]:g}, more than a whole "
                f"turn, as {len(beyond)} of {len(found)} rows; expected radians: if these are degrees, multiply with "
                f"pi / 180"
            )
    return notes


def _check_ranges(csv: Csv, ranges: Array) -> None:
    """InputError for a distance that is none: many sensors write 0 or less where they saw nothing."""
    bad = np.flatnonzero(ranges <= 0.0)
    if len(bad):
        raise csv.fail(
            int(bad[0]),
            f"a range is above 0, found {ranges[bad[0]]:g} ({len(bad)} of {len(ranges)} rows are 0 or less); "
            f"leave such rows out",
            "range",
        )


def write_values(table: Table) -> Array:
    """The inverse of `read_values`: (m, columns)."""
    if table.row.measures_pose:
        return write_poses(pose_of(table.values, table.dim))
    if table.model == "corners":
        angles = directions(3).angles(table.values[:, :12].reshape(-1, 4, 3))
        places = table.values[:, 12:].reshape(-1, 4, 3)
        return np.concatenate([angles, places], -1).swapaxes(1, 2).reshape(-1, 20)
    if table.dim == 3 and table.model in ("bearing", "range_bearing"):
        x, y, z = table.values[:, -3:].T
        angles = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], -1)
        return np.concatenate([table.values[:, :-3], angles], -1)
    return table.values


def read_poses(csv: Csv, dim: int) -> Pose:
    """Poses (m,) from columns. InputError for a quaternion that is not of length 1."""
    numbers = csv.numbers(*POSE[dim])
    if dim == 2:
        return Pose.from_xytheta(numbers)
    length = np.linalg.norm(numbers[:, 3:], axis=-1)
    bad = np.flatnonzero(np.abs(length - 1.0) > 1e-3)
    if len(bad):
        raise csv.fail(
            int(bad[0]), f"a unit quaternion (qw, qx, qy, qz) has length 1, found {length[bad[0]]:.4g}", "qw"
        )
    return Pose.from_quaternion(numbers[:, :3], numbers[:, 3:])


def write_poses(poses: Pose) -> Array:
    """The inverse of `read_poses`."""
    if poses.dim == 2:
        return poses.xytheta()
    return np.concatenate([poses.translation, poses.quaternion_wxyz()], -1)


def kind_of(csv: Csv, *, poses_only: bool) -> Kind:
    """What a file of truth or initial values holds, told by its columns."""
    for kind, names in ((Kind.POSE3, POSE[3]), (Kind.POSE2, POSE[2]), (Kind.POINT3, POINT[3]), (Kind.POINT2, POINT[2])):
        if csv.has(*names) and (kind.is_pose or not poses_only):
            return kind
    points = "" if poses_only else ", or x, y or x, y, z of points"
    raise InputError(
        f"expected the columns x, y, theta or x, y, z, qw, qx, qy, qz of poses{points}; found {', '.join(csv.columns)}",
        path=csv.path, line=1,
    )  # fmt: skip


def read_noise(
    csv: Csv, names: tuple[str, ...], sigma: list[float] | None, covariance: list[list[float]] | None
) -> Array:
    """Whitening (m, r, r) of rows that bring their noise, else (1, r, r) of what is stated for all.

    InputError for noise that is missing, of the wrong length, not symmetric or not positive definite: with the line.
    """
    for columns, whiten in (
        (covariance_columns(names), whitening),
        (information_columns(names), whitening_of_information),
    ):
        if csv.has(*columns):
            full = np.zeros((len(csv), len(names), len(names)))
            above = np.triu_indices(len(names))
            full[:, above[0], above[1]] = full[:, above[1], above[0]] = csv.numbers(*columns)
            return _whitened(csv, full, whiten)
    if csv.has(*sigma_columns(names)):
        sigmas = csv.numbers(*sigma_columns(names))
        bad = np.argwhere(sigmas <= 0.0)
        if len(bad):
            row, column = bad[0]
            raise csv.fail(
                int(row),
                f"standard deviations are above 0, found {sigmas[row, column]:g}",
                sigma_columns(names)[column],
            )
        return np.asarray(np.eye(len(names)) / sigmas[:, None, :])
    begun = [name for name in noise_columns(names) if csv.has(name)]
    if begun:
        families = (sigma_columns(names), covariance_columns(names), information_columns(names))
        needed = next(family for family in families if begun[0] in family)
        missing = next(name for name in needed if not csv.has(name))
        raise InputError(f"there is '{begun[0]}' but no such column", path=csv.path, line=1, field=missing)
    stated = np.diag(np.square(sigma)) if sigma is not None else covariance
    if stated is None:
        raise InputError(
            f"no noise is given: write sigma = [...] ({', '.join(names)}) into team.toml, or add the columns "
            f"{', '.join(sigma_columns(names))}",
            path=csv.path,
        )
    if np.shape(np.asarray(stated, object)) != (len(names), len(names)):
        shape = f"{len(names)} numbers" if sigma is not None else f"{len(names)} rows of {len(names)} numbers"
        raise InputError(
            f"expected {shape} ({', '.join(names)})", path=csv.path.parent / "team.toml",
            field=f"{csv.path.name}: {'sigma' if sigma is not None else 'covariance'}",
        )  # fmt: skip
    try:
        return whitening(np.asarray(stated, float)[None])
    except ModelError as error:
        raise InputError(
            _without_index(error), path=csv.path.parent / "team.toml", field=f"{csv.path.name}: covariance"
        ) from None


def _whitened(csv: Csv, matrices: Array, whiten: Callable[[Array], Array]) -> Array:
    try:
        return whiten(matrices)
    except ModelError:
        for row, matrix in enumerate(matrices):
            try:
                whiten(matrix[None])
            except ModelError as error:
                raise csv.fail(row, _without_index(error)) from None
        raise


def _without_index(error: ModelError) -> str:
    said = str(error)
    for noun in ("covariance", "information"):
        said = said.replace(f"{noun} 0 ", f"{noun} ", 1)
    return f"the {said}"


def covariance_of(whitening: Array) -> Array:
    """(W'W)^-1."""
    inverse = np.linalg.inv(whitening)
    return np.asarray(inverse @ np.swapaxes(inverse, -1, -2))


def upper(covariances: Array) -> Array:
    """The upper triangles (m, r (r + 1) / 2), row by row."""
    above = np.triu_indices(covariances.shape[-1])
    return np.asarray(covariances[:, above[0], above[1]])


def ticks_of(csv: Csv, name: str, tick_s: float) -> IntArray:
    """A column of stamps [s] as ticks. InputError for a time before 0 or too late to be a stamp."""
    seconds = csv.numbers(name)[:, 0]
    limit = float(1 << 51)
    bad = np.flatnonzero((seconds < 0.0) | (seconds / tick_s >= limit))
    if len(bad):
        found = float(seconds[bad[0]])
        raise csv.fail(
            int(bad[0]), f"expected a time from 0 to {limit * tick_s:.3g} s, found {found:g}{_cure(found)}", name
        )
    return np.round(seconds / tick_s).astype(np.int64)


SINCE_1970 = (3.2e8, 4.1e9)
"""Seconds since 1970 of the years 1980 to 2100: what stamps of today's clocks lie between."""


def _cure(stamp: float) -> str:
    """What to try with a stamp that is no time in seconds."""
    if stamp < 0.0:
        return "; add an offset to all times"
    for unit, parts in (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)):
        if SINCE_1970[0] * parts <= stamp <= SINCE_1970[1] * parts:
            return f": it looks like {unit} since 1970; divide all times by {parts:g}"
    return "; are these milliseconds or nanoseconds? Divide all times by 1e3 or 1e9"
