"""Rows that came to a kink, where their prediction has no derivative: what is seen stands on its sensor, or a rotation
is off by half a turn.

A bearing to where its sensor stands may point anywhere, a range has the tip of its cone there, and beyond half a turn a
rotation comes back from the other side. The cost may have its least at such a point, within a jump or a ridge that no
step by derivatives leaves. What a row says there is nothing: a search can go on without it for a while.
"""

import numpy as np

from teamslam.geometry import Array, BoolArray, Pose, lift_points
from teamslam.model import Table, Values

ON_IT = 1e-6  # of the distance before: so near is on the sensor
HALF = 1e-4  # [rad] from half a turn


def at_kink(table: Table, before: Values, now: Values) -> BoolArray:
    """Which rows (m,) of a table are at a kink now, and were not before."""
    if table.model in ("bearing", "range", "range_bearing"):
        return np.asarray(_distances(table, now) <= ON_IT * _distances(table, before))
    if table.model in ("relative_pose", "pose"):
        return np.asarray((_off(table, now) > np.pi - HALF) & (_off(table, before) <= np.pi - HALF))
    return np.zeros(len(table), bool)


def _distances(table: Table, values: Values) -> Array:
    """From the sensor to what it sees (m,)."""
    observer, target = table.ends(values)
    assert observer is not None
    sensor = observer if table.sensor is None else observer @ table.sensor
    seen = target.translation if isinstance(target, Pose) else target
    return np.asarray(np.linalg.norm(sensor.unact(lift_points(seen, sensor.dim)), axis=-1))


def _off(table: Table, values: Values) -> Array:
    """The angle (m,) between the rotation that was measured and the one that is there."""
    return np.asarray(np.linalg.norm(table.residual(values)[:, table.dim :], axis=-1))
