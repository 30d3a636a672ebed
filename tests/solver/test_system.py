"""The assembled problem against dense differences: cost, gradient and Hessian, for every world, loss and kind of
term."""

from dataclasses import replace

import numpy as np
import pytest

import oracle
from sightings import SETTINGS, Setting, every_table, world
from teamslam.geometry import Pose
from teamslam.joining import build, split
from teamslam.model import LOSSES, Loss, Values
from teamslam.solver import SubmapTerm, System
from worlds import WORLDS, team


def perturbed(values: Values, seed: int, size: float = 0.1) -> Values:
    return values.retract(size * np.random.default_rng(seed).standard_normal(values.layout.dof))


def unknowns(system: System, values: Values) -> np.ndarray:
    return values.layout.unknowns(system.free.keys)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("loss", LOSSES)
def test_tables_linearise_as_differences_do(world: str, loss: str) -> None:
    dataset = team(world, robots=2, poses=4, landmarks=3, sigma=0.1).with_loss(Loss(loss, 1.5), odometry=True)
    assert dataset.truth is not None
    values = perturbed(dataset.truth.only(dataset.layout.keys), 1)
    fixed = dataset.pose_keys[1][:1]
    system = System(values.layout, tables=dataset.tables, fixed=fixed)
    at = system.linearise(values)
    h, g = oracle.normal_equations(list(dataset.tables), [], values, unknowns(system, values))
    assert at.cost == pytest.approx(oracle.cost(list(dataset.tables), [], values), rel=1e-12)
    np.testing.assert_allclose(at.hessian.to_csr().toarray(), h, atol=1e-6 * np.abs(h).max())
    np.testing.assert_allclose(at.gradient, g, atol=1e-6 * np.abs(g).max())


@pytest.mark.parametrize("setting", SETTINGS, ids=str)
def test_every_sensor_weighs_its_noise_in_the_coordinates_of_its_model(setting: Setting) -> None:
    """Whitening that mixes and scales the rows of a residual tells one set of axes from another."""
    rng = np.random.default_rng(0)
    truth = world(rng, setting)
    values = perturbed(truth, 1, 0.3)
    for table in every_table(rng, truth, setting):
        system = System(values.layout, tables=[table])
        assert system.cost(values) == pytest.approx(oracle.cost([table], [], values), rel=1e-9), table.model
        h, g = oracle.normal_equations([table], [], values, np.arange(values.layout.dof))
        at = system.linearise(values)
        np.testing.assert_allclose(at.gradient, g, atol=1e-6 * np.abs(g).max(), err_msg=table.model)
        np.testing.assert_allclose(at.hessian.to_csr().toarray(), h, atol=1e-6 * np.abs(h).max(), err_msg=table.model)
        rows, whole = system.jacobian(0, values), at.hessian.to_csr().toarray()
        np.testing.assert_allclose((rows.T @ rows).toarray(), whole, atol=1e-12 * np.abs(whole).max())
        pull = rows.T @ system.whitened(0, values).ravel()
        np.testing.assert_allclose(pull, at.gradient, atol=1e-12 * np.abs(at.gradient).max())


@pytest.mark.parametrize("setting", SETTINGS, ids=str)
def test_another_whitening_stands_as_if_rows_had_come_with_it(setting: Setting) -> None:
    rng = np.random.default_rng(3)
    truth = world(rng, setting)
    values = perturbed(truth, 1, 0.3)
    for table in every_table(rng, truth, setting):
        system, shape = System(values.layout, tables=[table]), (len(table), *table.whitening.shape[1:])
        system.linearise(values)
        other = np.broadcast_to(table.whitening, shape) * rng.uniform(0.5, 2.0, (len(table), 1, 1))
        system.set_whitening(0, other)
        fresh = System(values.layout, tables=[replace(table, whitening=other)])
        at, expected = system.linearise(values), fresh.linearise(values)
        np.testing.assert_array_equal(at.hessian.to_csr().toarray(), expected.hessian.to_csr().toarray())
        np.testing.assert_array_equal(at.gradient, expected.gradient)
        np.testing.assert_array_equal(system.whitened(0, values), fresh.whitened(0, values))
        half = system.jacobian(0, values).toarray()
        np.testing.assert_array_equal(half, fresh.jacobian(0, values).toarray())


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("model", ["range", "bearing", "range_bearing", "point"])
def test_sightings_of_robots_without_heading(world: str, model: str) -> None:
    if world == "3d" and "bearing" in model:
        pytest.skip("noise on the sphere belongs to the simulator's tests")
    dataset = team(world, robots=2, poses=4, landmarks=3, robot_model=model)
    assert dataset.truth is not None
    values = perturbed(dataset.truth.only(dataset.layout.keys), 2)
    system = System(values.layout, tables=dataset.tables, fixed=dataset.pose_keys[1][:1])
    at = system.linearise(values)
    h, g = oracle.normal_equations(list(dataset.tables), [], values, unknowns(system, values))
    np.testing.assert_allclose(at.hessian.to_csr().toarray(), h, atol=1e-6 * np.abs(h).max())
    np.testing.assert_allclose(at.gradient, g, atol=1e-6 * np.abs(g).max())


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("slope", [False, True])
def test_submaps_linearise_as_differences_do(world: str, slope: bool) -> None:
    dataset = team(world, robots=2, poses=5, landmarks=4)
    assert dataset.truth is not None
    submaps = [build(piece) for piece in split(dataset)]
    rng = np.random.default_rng(0)
    terms = [
        SubmapTerm(s.base, s.values, s.information, rng.standard_normal(s.dof) if slope else None) for s in submaps
    ]
    values = perturbed(dataset.truth.only(dataset.layout.keys), 3)
    system = System(values.layout, submaps=terms, fixed=np.array([submaps[0].base]))
    at = system.linearise(values)
    h, g = oracle.normal_equations([], terms, values, unknowns(system, values))
    assert at.cost == pytest.approx(oracle.cost([], terms, values), rel=1e-10)
    np.testing.assert_allclose(at.hessian.to_csr().toarray(), h, atol=1e-6 * np.abs(h).max())
    np.testing.assert_allclose(at.gradient, g, atol=1e-6 * np.abs(g).max())


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("loss", LOSSES)
def test_with_all_curvature_the_matrix_is_how_the_gradient_falls(world: str, loss: str) -> None:
    """d'Hd is half the second derivative of F along x (+) t d: submaps with slopes and tables together."""
    dataset = team(world, robots=2, poses=5, landmarks=4, sigma=0.1).with_loss(Loss(loss, 1.5))
    assert dataset.truth is not None
    rng = np.random.default_rng(0)
    submaps = [build(piece) for piece in split(dataset)]
    terms = [SubmapTerm(s.base, s.values, s.information, rng.standard_normal(s.dof)) for s in submaps]
    values = perturbed(dataset.truth.only(dataset.layout.keys), 3)
    system = System(values.layout, tables=dataset.tables, submaps=terms, fixed=np.array([submaps[0].base]))
    h = system.linearise(values, curvature="all").hessian.to_csr()
    for d in rng.standard_normal((5, system.free.dof)):
        ahead, behind = (system.linearise(system.retract(values, s * d)).gradient for s in (1e-5, -1e-5))
        assert float(d @ (h @ d)) == pytest.approx(float((behind - ahead) @ d) / 2e-5, rel=1e-5)


@pytest.mark.parametrize("world", WORLDS)
def test_moving_the_world_changes_no_cost(world: str) -> None:
    dataset = team(world, robots=2, poses=4, landmarks=3)
    assert dataset.truth is not None
    values = dataset.truth.only(dataset.layout.keys)
    system = System(values.layout, tables=dataset.tables)
    frame = Pose.from_xytheta(np.array([3.0, -2.0, 1.1]))
    assert system.cost(values.transform(frame)) == pytest.approx(system.cost(values), rel=1e-9)


def test_retract_moves_only_the_free() -> None:
    dataset = team("planar", robots=2, poses=4, landmarks=3)
    assert dataset.truth is not None
    values = dataset.truth.only(dataset.layout.keys)
    held = dataset.pose_keys[1][:2]
    system = System(values.layout, tables=dataset.tables, fixed=held)
    moved = system.retract(values, np.full(system.free.dof, 0.1))
    change = moved.minus(values)
    np.testing.assert_allclose(change[values.layout.unknowns(held)], 0.0, atol=1e-15)
    np.testing.assert_allclose(change[values.layout.unknowns(system.free.keys)], 0.1, atol=1e-12)
