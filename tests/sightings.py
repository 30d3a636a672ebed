"""Tables of every row of MODELS that sees a random world: what the tests of sensors and tables start from."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from strategies import random_poses
from teamslam.geometry import Array, Pose
from teamslam.model import MODELS, Kind, Table, Values, landmark_key, pose_key


@dataclass(frozen=True)
class Setting:
    """A kind of robot, a kind of landmark, and the dimension of the measurements between them."""

    robot: Kind
    landmark: Kind
    dim: int


# The plane, planar robots that see points in space (the paper's own), space, and flat sensors in space.
SETTINGS = [
    Setting(Kind.POSE2, Kind.POINT2, 2),
    Setting(Kind.POSE2, Kind.POINT3, 3),
    Setting(Kind.POSE3, Kind.POINT3, 3),
    Setting(Kind.POSE2, Kind.POINT3, 2),
]
OBSERVERS = pose_key(1, np.arange(4))
OTHERS = pose_key(2, np.arange(4))
MARKS = landmark_key(np.arange(10, 14))


def world(rng: np.random.Generator, setting: Setting) -> Values:
    """Two robots with four poses each, and four landmarks, some metres apart."""
    d = setting.robot.dim
    both = random_poses(rng, d, 8, turn=3.0)
    return Values.of(
        {
            setting.robot: (np.concatenate([OBSERVERS, OTHERS]), both),
            setting.landmark: (MARKS, rng.normal(scale=5.0, size=(4, setting.landmark.dim))),
        }
    )


def random_whitening(rng: np.random.Generator, rows: int, *batch: int) -> Array:
    """Upper left to lower right: any invertible matrix is a whitening."""
    return np.eye(rows) + 0.3 * rng.normal(size=(*batch, rows, rows))


def table_of(
    rng: np.random.Generator, model: str, dim: int, keys: Array, values: Values, sensor: Pose | None = None
) -> Table:
    """Perfect sightings: what the world's values predict."""
    row = MODELS[model]
    blank = np.zeros((len(keys), row.z_size(dim)))
    blank[:, row.z_size(dim) - row.given :] = rng.normal(size=(len(keys), row.given))  # where corners are, say
    whitening = random_whitening(rng, row.residual_rows(dim), len(keys))
    ids = np.arange(len(keys))
    table = Table(1, "sightings", model, dim, keys, blank, whitening, ids, sensor)
    return Table(1, "sightings", model, dim, keys, table.predict(values), whitening, ids, sensor)


def every_table(rng: np.random.Generator, values: Values, setting: Setting, *, sensor: bool = True) -> Iterator[Table]:
    """Each row of MODELS, seeing robots and (where it may) landmarks, with and without a sensor pose in the body."""
    planar = setting.robot is Kind.POSE2
    sensors = [None, random_poses(rng, 3 if setting.dim == 3 else 2, spread=0.5)] if sensor else [None]
    for model, row in MODELS.items():
        # A pose is measured in the dimension that robots move in; in the plane that of a landmark may be higher.
        dim = setting.robot.dim if row.measures_pose and planar else setting.dim
        if not row.z_size(dim):
            continue
        for targets in [OTHERS] if row.targets_pose else [OTHERS, MARKS]:
            if row.unary:
                if not row.targets_pose and setting.landmark.dim != dim and targets is MARKS:
                    continue
                for eye in [None] if targets is MARKS else sensors:
                    if eye is None or eye.dim <= dim:
                        yield table_of(rng, model, dim, targets[:, None], values, eye)
                continue
            for eye in sensors:
                if eye is not None and eye.dim > dim:
                    continue
                yield table_of(rng, model, dim, np.stack([OBSERVERS, targets], -1), values, eye)
