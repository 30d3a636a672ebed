"""Marginals of a planar team's log by the GTSAM wheel, as its noise is stated: range-bearing sightings and odometry."""

from typing import Any

import gtsam
import numpy as np

from teamslam.model import Dataset, Table, Values, is_pose


def nees(log: Dataset, truth: Values, base: int) -> tuple[float, float]:
    """The mean NEES/dof of poses and of landmarks one by one, in the frame of the true base."""
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key in truth.layout.keys.tolist():
        initial.insert(key, _of(truth, key))
    for table in log.tables:
        for row in range(len(table)):
            graph.push_back(_factor(table, row, truth))
    graph.push_back(gtsam.NonlinearEqualityPose2(base, _of(truth, base)))
    found = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    marginals, sums = gtsam.Marginals(graph, found), {True: [0.0, 0.0], False: [0.0, 0.0]}
    for key in truth.layout.keys.tolist():
        if key == base or not found.exists(key):
            continue
        robot = bool(is_pose(key))
        error = found.atPose2(key).localCoordinates(_of(truth, key)) if robot else _of(truth, key) - found.atPoint2(key)
        sums[robot][0] += float(error @ np.linalg.solve(marginals.marginalCovariance(key), error))
        sums[robot][1] += len(error)
    return sums[True][0] / sums[True][1], sums[False][0] / sums[False][1]


def _of(values: Values, key: int) -> Any:
    if is_pose(key):
        return gtsam.Pose2(*values.pose(key).xytheta())
    return values.positions(np.array([key]), 2)[0]


def _factor(table: Table, row: int, truth: Values) -> Any:
    keys, z = table.keys[row].tolist(), table.values[row]
    whitening = table.whitening[row if len(table.whitening) > 1 else 0]
    if table.model == "relative_pose":
        step = gtsam.Pose2(z[0], z[1], np.arctan2(z[4], z[2]))
        turn = np.eye(3)  # GTSAM's error of a step is in the frame of its end
        turn[:2, :2] = step.rotation().matrix()
        whitened = whitening @ turn
        return gtsam.BetweenFactorPose2(*keys, step, gtsam.noiseModel.Gaussian.Information(whitened.T @ whitened))
    swapped = whitening[:, ::-1]  # bearing before range
    noise = gtsam.noiseModel.Gaussian.Information(swapped.T @ swapped)
    bearing, distance = gtsam.Rot2(z[1]), float(z[0])
    seen = gtsam.BearingRangeFactorPose2 if is_pose(keys[1]) else gtsam.BearingRangeFactor2D
    return seen(*keys, bearing, distance, noise)
