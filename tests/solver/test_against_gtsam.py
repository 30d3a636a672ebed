"""The full least squares against GTSAM: a solver of other people, fed the same residuals as custom factors.

GTSAM has its own variables, charts, Jacobian assembly, elimination and stopping; only the residual functions are
ours. At the optimum the cost, the estimate and the covariances must agree: the cost and estimate to 1e-9 relative,
covariances to 1e-6.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.joining import full
from teamslam.model import Dataset, Kind, Table, Values
from teamslam.solver import Covariances, Options
from worlds import WORLDS, team

gtsam = pytest.importorskip("gtsam", reason="the GTSAM wheel is an oracle of development, not installed here")


def to_gtsam(values: Values, key: int) -> Any:
    kind = Kind(int(values.layout.kinds[values.layout.index(key)]))
    thing = values.gather(np.array(key), kind)
    if not isinstance(thing, Pose):
        return np.asarray(thing)
    if kind is Kind.POSE2:
        return gtsam.Pose2(*thing.xytheta())
    return gtsam.Pose3(gtsam.Rot3(thing.rotation), thing.translation)


def of_gtsam(graph_values: Any, key: int, kind: Kind) -> Pose | np.ndarray:
    if kind is Kind.POSE2:
        p = graph_values.atPose2(key)
        return Pose.from_xytheta(np.array([p.x(), p.y(), p.theta()]))
    if kind is Kind.POSE3:
        p = graph_values.atPose3(key)
        return Pose(p.rotation().matrix(), p.translation())
    return np.asarray(graph_values.atVector(key)) if kind else np.zeros(0)


def moved(thing: Pose | np.ndarray, tangent: np.ndarray) -> Pose | np.ndarray:
    """GTSAM's charts: the full right exponential; for Pose3 the rotation stands first."""
    if not isinstance(thing, Pose):
        return thing + tangent
    if thing.dim == 2:
        p = gtsam.Pose2(*thing.xytheta()).compose(gtsam.Pose2.Expmap(tangent))
        return Pose.from_xytheta(np.array([p.x(), p.y(), p.theta()]))
    p = gtsam.Pose3(gtsam.Rot3(thing.rotation), thing.translation).compose(gtsam.Pose3.Expmap(tangent))
    return Pose(p.rotation().matrix(), p.translation())


def factor(table: Table, row: int, kinds: list[Kind]) -> Any:
    one = table.select(np.array([row]))

    def error_of(things: list[Pose | np.ndarray]) -> np.ndarray:
        target = things[-1]
        if isinstance(target, Pose):
            target = target[None] if one.row.targets_pose else target.translation[None]
        else:
            target = target[None]
        observer = things[0]
        assert isinstance(observer, Pose)
        h = one.predict_from(observer[None], target)
        return np.asarray((one.whitening @ one.row.minus(one.values, h, one.dim)[..., None])[0, :, 0])

    def evaluate(this: Any, values: Any, jacobians: list[np.ndarray] | None) -> np.ndarray:
        things = [of_gtsam(values, k, kind) for k, kind in zip(this.keys(), kinds, strict=True)]
        error = error_of(things)
        if jacobians is not None:
            for slot, kind in enumerate(kinds):
                columns = []
                for step in np.eye(kind.dof) * 1e-6:
                    ahead, behind = list(things), list(things)
                    ahead[slot], behind[slot] = moved(things[slot], step), moved(things[slot], -step)
                    columns.append((error_of(ahead) - error_of(behind)) / 2e-6)
                jacobians[slot] = np.asfortranarray(np.stack(columns, -1))
        return error

    rows = one.row.residual_rows(one.dim)
    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows), [int(k) for k in one.keys[0]], evaluate)


def gtsam_optimum(dataset: Dataset, start: Values, base: int) -> tuple[float, Callable[[int], Any], Any]:
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    kinds = {int(k): Kind(int(v)) for k, v in zip(start.layout.keys, start.layout.kinds, strict=True)}
    for key in kinds:
        initial.insert(key, to_gtsam(start, key))
    for table in dataset.tables:
        for row in range(len(table)):
            graph.add(factor(table, row, [kinds[int(k)] for k in table.keys[row]]))
    held = to_gtsam(start, base)
    equality = gtsam.NonlinearEqualityPose2 if isinstance(held, gtsam.Pose2) else gtsam.NonlinearEqualityPose3
    graph.add(equality(base, held))
    settings = gtsam.GaussNewtonParams()
    settings.setRelativeErrorTol(1e-16)
    settings.setAbsoluteErrorTol(1e-16)
    settings.setMaxIterations(25)
    found = gtsam.GaussNewtonOptimizer(graph, initial, settings).optimize()
    return 2.0 * graph.error(found), lambda key: of_gtsam(found, key, kinds[key]), gtsam.Marginals(graph, found)


@pytest.mark.parametrize("world", WORLDS)
def test_cost_estimate_and_covariances_agree(world: str) -> None:
    dataset = team(world, robots=2, poses=6, landmarks=4, sigma=0.05, sigma_odometry=0.05)
    ours = full(dataset, options=Options(decrement=1e-10)).map
    cost, estimate, marginals = gtsam_optimum(dataset, ours.all_values, ours.base)
    assert ours.cost == pytest.approx(cost, rel=1e-9)
    covariances = Covariances.of_map(ours)
    for key, kind in zip(ours.values.layout.keys, ours.values.layout.kinds, strict=True):
        mine, theirs = ours.values.gather(key, Kind(int(kind))), estimate(int(key))
        apart = mine.minus(theirs) if isinstance(mine, Pose) else mine - theirs
        np.testing.assert_allclose(apart, 0.0, atol=1e-8)
        c = np.asarray(marginals.marginalCovariance(int(key)))
        if isinstance(mine, Pose):
            c = turned(c, mine)
        np.testing.assert_allclose(covariances.of(int(key)), c, atol=1e-6 * np.abs(c).max())


def turned(covariance: np.ndarray, pose: Pose) -> np.ndarray:
    """From GTSAM's tangent (space: [w, v]; plane: [v, w]; v in the body) to [dT, dw]: dT = R v."""
    d = pose.dim
    if d == 3:
        order = [3, 4, 5, 0, 1, 2]
        covariance = covariance[np.ix_(order, order)]
    turn = np.eye(len(covariance))
    turn[:d, :d] = pose.rotation
    return np.asarray(turn @ covariance @ turn.T)
