"""Measurements that say nothing in some direction: what is left counts, and the rest is as if it had not been asked."""

from dataclasses import replace

import numpy as np
import pytest

from oracle import scipy_optimum
from teamslam.model import Dataset, Loss, Table, whitening_of_information
from teamslam.solver import Covariances, System, optimise, optimise_graduated
from thinned import thinned
from worlds import WORLDS, team


def half_blind(table: Table, rng: np.random.Generator) -> Table:
    """Every other row says nothing in one direction, at random along or across the numbers that it measures."""
    whitening = np.broadcast_to(table.whitening, (len(table), *table.whitening.shape[1:])).copy()
    size = whitening.shape[-1]
    for row in range(0, len(table), 2):
        blind = np.eye(size)[rng.integers(size)] if rng.random() < 0.5 else rng.normal(size=size)
        keeps = np.eye(size) - np.outer(blind, blind) / (blind @ blind)
        whitening[row] = whitening_of_information(keeps @ whitening[row].T @ whitening[row] @ keeps)
    return replace(table, whitening=whitening)


def problem(world: str, seed: int) -> tuple[Dataset, System]:
    """A team of which every sighting is half blind."""
    dataset = team(world, robots=2, poses=4, landmarks=3, sees=0.9, sigma=0.1, every=1, seed=seed)
    rng = np.random.default_rng(seed)
    tables = [t if t.source == "odometry" else half_blind(t, rng) for t in dataset.tables]
    assert dataset.truth is not None
    layout = dataset.truth.only(dataset.layout.keys).layout
    return dataset, System(layout, tables=tables, fixed=dataset.pose_keys[1][:1])


@pytest.mark.parametrize(("world", "loss"), thinned(2, list(WORLDS), ["squared", "cauchy"]))
def test_the_optimum_and_its_degrees_of_freedom(world: str, loss: str) -> None:
    dataset, system = problem(world, seed=3)
    assert dataset.truth is not None
    system = System(
        system.layout, tables=[t.with_loss(Loss(loss, 2.0)) for t in system.tables], fixed=dataset.pose_keys[1][:1]
    )
    start = dataset.truth.only(system.layout.keys)
    solution = optimise(system, start)
    least, where = scipy_optimum(system, start)
    assert solution.converged
    assert solution.cost == pytest.approx(least, rel=1e-8)
    np.testing.assert_allclose(solution.values.minus(where), 0.0, atol=1e-5)
    ranks = [np.broadcast_to(np.linalg.matrix_rank(t.whitening), len(t)) for t in system.tables]
    assert solution.rows == sum(int(r.sum()) for r in ranks) < dataset.dof
    assert solution.dof == solution.rows - system.free.dof
    key = int(system.free.keys[-1])
    at = system.free.unknowns(np.array([key]))
    dense = np.linalg.inv(solution.information.toarray())[np.ix_(at, at)]
    np.testing.assert_allclose(Covariances(system.free, solution.information).of(key), dense, rtol=1e-7, atol=1e-12)


def test_chi2_is_that_of_its_degrees_of_freedom() -> None:
    """Over many noises the cost is chi2 of the dof that are counted, and not of all rows."""
    found = []
    for seed in range(40):
        dataset, system = problem("2d", seed)
        assert dataset.truth is not None
        # The noise of the world is what the whole whitening says: what singular rows keep of it is theirs.
        solution = optimise(system, dataset.truth.only(system.layout.keys))
        found.append((solution.chi2, solution.dof))
    chi2, dof = np.array(found).sum(0)
    assert abs(chi2 - dof) < 4.0 * np.sqrt(2.0 * dof)


def test_a_direction_without_information_is_a_measurement_without_it() -> None:
    """A point whose height says nothing is a point seen in the plane."""
    dataset = team("planar", robots=1, poses=4, landmarks=3, sees=0.9)
    assert dataset.truth is not None
    flat = np.diag([50.0, 50.0, 0.0])
    start = dataset.truth.only(dataset.layout.keys)
    odometry, seen = dataset.tables
    flats = replace(seen, whitening=flat[None])
    heights = replace(seen, whitening=np.diag([0.0, 0.0, 1.0])[None])
    both = replace(seen, whitening=np.diag([50.0, 50.0, 1.0])[None])
    base = dataset.pose_keys[1][:1]
    apart = optimise(System(start.layout, tables=[odometry, flats, heights], fixed=base), start)
    whole = optimise(System(start.layout, tables=[odometry, both], fixed=base), start)
    assert apart.cost == pytest.approx(whole.cost, rel=1e-9) and apart.rows == whole.rows
    np.testing.assert_allclose(apart.information.toarray(), whole.information.toarray(), rtol=1e-7, atol=1e-6)


def test_gates_of_outliers_count_what_a_row_measures() -> None:
    dataset, system = problem("2d", seed=1)
    assert dataset.truth is not None
    found = optimise_graduated(system, dataset.truth.only(system.layout.keys), range(len(system.tables)))
    assert found.rejected <= 3
