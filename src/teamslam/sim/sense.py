"""Sensors: what a robot measures of a world, with noise, drop-outs and false alarms.

z = h(truth) (+) n          h: the model's own prediction, so that simulation and estimation share one law
"""

from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Array, IntArray, Pose
from teamslam.model import MODELS, Table, Values
from teamslam.sim import noise
from teamslam.sim.view import anywhere_in_view


@dataclass(frozen=True)
class Odometry:
    """What a robot measures of each of its steps, a relative pose: `sigma_m` an axis, `sigma_rad` an angle."""

    sigma_m: float = 0.02
    sigma_rad: float = 0.01

    def __post_init__(self) -> None:
        _check(0.0 < self.sigma_m < np.inf, "sigma_m", "a standard deviation is above zero", self.sigma_m)
        _check(0.0 < self.sigma_rad < np.inf, "sigma_rad", "a standard deviation is above zero", self.sigma_rad)


@dataclass(frozen=True)
class Sensor:
    """An instrument that sees landmarks or robots.

    `model`: a row of MODELS with an observer. `sigma_m`, `sigma_rad`: of each length and angle that it reports, or
    `sigmas`, one for each number of its residual. `range_m` and `field_of_view_deg` (about the forward axis; a cone in
    space) bound what it sees. It sits at `mount_xyz_m` in the robot's body, turned by `mount_yaw_deg`. It looks at
    every `every`-th pose; a share `dropouts` of sightings is lost, and a share `outliers` of the rest are false alarms,
    spread evenly over what it could see. Raises InputError for values that make no sense.
    """

    model: str = "point"
    sigma_m: float = 0.05
    sigma_rad: float = 0.02
    sigmas: tuple[float, ...] | None = None
    range_m: float = 5.0
    field_of_view_deg: float = 360.0
    mount_xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mount_yaw_deg: float = 0.0
    every: int = 1
    dropouts: float = 0.0
    outliers: float = 0.0

    def __post_init__(self) -> None:
        names = [name for name, row in MODELS.items() if not (row.unary or row.given)]
        _check(self.model in names, "model", f"a sensor is one of {', '.join(names)}", self.model)
        for name in ("sigma_m", "sigma_rad", "range_m"):
            _check(0.0 < getattr(self, name) < np.inf, name, "a number above zero is needed", getattr(self, name))
        _check(
            all(0.0 < s < np.inf for s in self.sigmas or ()),
            "sigmas",
            "standard deviations are above zero",
            self.sigmas,
        )
        _check(0.0 < self.field_of_view_deg <= 360.0, "field_of_view_deg", "at most 360", self.field_of_view_deg)
        _check(self.every >= 1, "every", "1 for each pose, 2 for every other, ...", self.every)
        for name in ("dropouts", "outliers"):
            _check(0.0 <= getattr(self, name) <= 1.0, name, "a share is between 0 and 1", getattr(self, name))

    @property
    def field_of_view_rad(self) -> float:
        """The full angle of view [rad]."""
        return float(np.deg2rad(self.field_of_view_deg))

    def mount(self, dim: int) -> Pose | None:
        """Where it sits in the body, as a pose of dimension 2 or 3; None where that is the body itself.

        Raises InputError for a mount above the plane in a world that has no height.
        """
        if not any(self.mount_xyz_m) and not self.mount_yaw_deg:
            return None
        x, y, _ = self.mount_xyz_m
        _check(
            not any(self.mount_xyz_m[dim:]), "mount_xyz_m", "a measurement in the plane has no height", self.mount_xyz_m
        )
        planar = Pose.from_xytheta(np.array([x, y, np.deg2rad(self.mount_yaw_deg)]))
        return Pose(planar.lift(dim).rotation, np.array(self.mount_xyz_m[:dim]))

    def eyes(self, bodies: Pose, dim: int) -> Pose:
        """Where it is when the robot's body is at `bodies` (n,)."""
        mount = self.mount(dim)
        return bodies.lift(dim) if mount is None else bodies.lift(dim) @ mount

    def standard_deviations(self, dim: int) -> Array:
        """One for each number of a residual (rows,)."""
        if self.sigmas is None:
            return noise.sigmas(self.model, dim, self.sigma_m, self.sigma_rad)
        rows = MODELS[self.model].residual_rows(dim)
        _check(len(self.sigmas) == rows, "sigmas", f"{self.model} needs {rows} standard deviations", self.sigmas)
        return np.asarray(self.sigmas, float)


def measure_steps(robot: int, keys: IntArray, odometry: Odometry, truth: Values, rng: np.random.Generator) -> Table:
    """The odometry of one robot between consecutive poses `keys` (n,)."""
    dim = 2 + int(truth.layout.kinds[truth.layout.index(keys[0])])
    sigma = noise.sigmas("relative_pose", dim, odometry.sigma_m, odometry.sigma_rad)
    pairs = np.stack([keys[:-1], keys[1:]], -1)
    table = blank(robot, "odometry", "relative_pose", dim, pairs, sigma)
    return _with_noise(table, sigma, truth, rng)


def measure_targets(
    robot: int, source: str, sensor: Sensor, dim: int, keys: IntArray, truth: Values, rng: np.random.Generator
) -> Table:
    """What a sensor reports of targets in view: `keys` (m, 2) pose, target, of which drop-outs are left out."""
    keys = keys[rng.random(len(keys)) >= sensor.dropouts]
    sigma = sensor.standard_deviations(dim)
    table = blank(robot, source, sensor.model, dim, keys, sigma, sensor.mount(dim))
    table = _with_noise(table, sigma, truth, rng)
    return _with_outliers(table, sensor, rng)


def blank(
    robot: int, source: str, model: str, dim: int, keys: IntArray, sigma: Array, mount: Pose | None = None
) -> Table:
    """A table whose measurements are still to be made."""
    zeros = np.zeros((len(keys), MODELS[model].z_size(dim)))
    return Table(robot, source, model, dim, keys, zeros, np.diag(1.0 / sigma)[None], np.arange(len(keys)), mount)


def _with_noise(table: Table, sigma: Array, truth: Values, rng: np.random.Generator) -> Table:
    drawn = sigma * rng.standard_normal((len(table), len(sigma)))
    return replace(table, values=noise.plus(table.model, table.predict(truth), drawn, table.dim))


def _with_outliers(table: Table, sensor: Sensor, rng: np.random.Generator) -> Table:
    wrong = rng.random(len(table)) < sensor.outliers
    ghosts = anywhere_in_view(len(table), table.dim, sensor.range_m, sensor.field_of_view_rad, rng)
    target = ghosts if table.row.measures_pose else ghosts.translation
    eye = Pose.identity(table.dim, (len(table),))
    seen = table.row.predict(eye, target, table.dim)
    return replace(table, values=np.where(wrong[:, None], seen, table.values))


def _check(holds: bool, field: str, expected: str, found: object) -> None:
    if not holds:
        raise InputError(f"{expected}; found {found}", field=field)
