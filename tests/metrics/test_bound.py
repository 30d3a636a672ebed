"""The Cramer-Rao bound: the solver's linearisation as oracle, and estimates that reach it."""

from dataclasses import replace

import numpy as np
import pytest

from metrics_maps import TEAMS, at_base, small
from teamslam.errors import ModelError
from teamslam.joining import full
from teamslam.metrics import cramer_rao, errors_at_base
from teamslam.model import Dataset
from teamslam.sim import SPACES, Options, PaperOptions, Robot, Sensor, simulate
from teamslam.solver import System


def by_the_solver(dataset: Dataset) -> np.ndarray:
    """J' W J at the truth from the native kernel's analytic Jacobians.

    Of measurements without noise: the solver's Jacobian is that of the residual, which depends on the noise in curved
    spaces, while the bound takes that of the prediction.
    """
    base, values = at_base(dataset)
    exact = [replace(table, values=table.predict(values)) for table in dataset.tables]
    system = System(values.layout, tables=exact, fixed=np.array([base]))
    return system.linearise(values).hessian.to_csr()


@pytest.mark.parametrize("team", TEAMS)
def test_the_bound_is_the_inverse_of_the_solvers_information(team: str) -> None:
    """Numeric differences here, analytic ones there."""
    dataset = small(team)
    expected = np.linalg.inv(by_the_solver(dataset).toarray())
    found = cramer_rao(dataset)
    assert np.allclose(found.covariance, expected, rtol=1e-5, atol=1e-8)
    given = cramer_rao(dataset, information=by_the_solver(dataset))
    assert np.allclose(given.covariance, expected, rtol=1e-9)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("model", ["range_bearing", "bearing", "range", "relative_pose"])
def test_every_sensor_has_its_bound(space: str, model: str) -> None:
    """Also those of curved spaces."""
    kind = Robot(landmarks=Sensor(model, range_m=8.0), robots=Sensor(model, range_m=8.0))
    dataset = simulate(Options(space=space, poses=15, landmarks=10, team=(kind,)), 4)
    found, expected = cramer_rao(dataset).covariance, np.linalg.inv(by_the_solver(dataset).toarray())
    scale = np.sqrt(np.diag(expected))
    assert np.allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-5)


def test_full_least_squares_reaches_the_bound_where_noise_is_small() -> None:
    """Efficiency: pooled errors of many runs against the bound."""
    options = PaperOptions("sufficient", 4, 0.01, 0.02)
    bound = cramer_rao(simulate(options)).per_number
    squared = []
    for seed in range(40):
        dataset = simulate(options, seed)
        found = errors_at_base(full(dataset).map, dataset.truth)
        squared.append([found.state**2, found.robot_pose**2, found.landmark**2])
    pooled = np.sqrt(np.mean(squared, 0))
    assert np.allclose(pooled, [bound.state, bound.robot_pose, bound.landmark], rtol=0.15)


def test_another_base_moves_the_uncertainty() -> None:
    """The pose that is the frame has none."""
    dataset = small("planar")
    other = int(dataset.pose_keys[2][3])
    found = cramer_rao(dataset, base=other)
    assert found.base == other and not found.layout.contains(other)
    assert found.layout.contains(int(dataset.pose_keys[1][0]))


def test_no_truth_no_bound() -> None:
    """In words."""
    dataset = small("planar")
    for truth in (None, dataset.truth.select(dataset.truth.layout.keys > 3)):
        with pytest.raises(ModelError, match="truth"):
            cramer_rao(replace(dataset, truth=truth))


def test_a_team_that_is_not_connected_has_no_bound() -> None:
    """Odometry alone leaves the robots' frames open."""
    dataset = small("planar")
    alone = dataset.with_tables(t for t in dataset.tables if t.source == "odometry")
    with pytest.raises(ModelError, match="determine"):
        cramer_rao(replace(alone, truth=dataset.truth.only(alone.layout.keys)))
