"""Small pictures of what is believed and of what was seen, for the cards of records."""

from collections.abc import Iterable

import numpy as np

from teamslam.cards import lanes, plan
from teamslam.geometry import Array, IntArray
from teamslam.model.keys import WORLD, Names, is_landmark, is_pose, robot_of
from teamslam.model.tables import Table
from teamslam.model.values import Values


def portrait(values: Values, marks: IntArray | None = None, regions: Array | None = None) -> str:
    """Ways and landmarks from above; `marks` (m,) are the landmarks whose covariances `regions` (m, 2, 2) has."""
    keys = np.sort(values.layout.keys)
    poses = keys[is_pose(keys)]
    ways = [values.positions(poses[robot_of(poses) == robot], 2) for robot in np.unique(robot_of(poses))]
    own = keys[is_landmark(keys) & (keys != WORLD)] if marks is None else marks
    return plan(ways, values.positions(own, 2), regions)


def log_portrait(tables: Iterable[Table], names: Names) -> str:
    """Which sensor of which robot measured when: a lane for each."""
    times: dict[str, Array] = {}
    for table in tables:
        observers = table.keys[is_pose(table.keys[:, 0]), 0]
        name = f"{names.robot(table.robot)} {table.source}"
        times[name] = np.concatenate([times.get(name, np.zeros(0)), names.stamps_s(observers)])
    return lanes(times)
