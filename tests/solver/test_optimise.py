"""The optimum against SciPy's least squares; every step rule reaches it; failures say what is wrong."""

import itertools
import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from oracle import scipy_optimum
from teamslam.errors import InputError, SolveError
from teamslam.model import Dataset, Kind, Layout, Loss, Values, landmark_key
from teamslam.solver import RULES, Covariances, Factor, Options, Status, Step, System, optimise
from teamslam.solver.covariance import MANY
from worlds import WORLDS, team


def problem(world: str, **options: float) -> tuple[Dataset, System, Values]:
    dataset = team(world, robots=2, poses=5, landmarks=4, **options)  # type: ignore[arg-type]
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    return dataset, System(start.layout, tables=dataset.tables, fixed=dataset.pose_keys[1][:1]), start


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("rule", RULES)
def test_every_rule_reaches_the_optimum(world: str, rule: str) -> None:
    _, system, start = problem(world, sigma=0.1)
    solution = optimise(system, start, Options(rule=rule, decrement=1e-9))
    least, where = scipy_optimum(system, start)
    assert solution.converged
    assert solution.cost == pytest.approx(least, rel=1e-9)
    np.testing.assert_allclose(solution.values.minus(where), 0.0, atol=1e-6)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("robots_by", ["relative_pose", "range"])
@pytest.mark.parametrize("decrement", [1e-1, 1e-3, 1e-6])
def test_a_run_ends_as_near_to_the_optimum_as_it_says(world: str, robots_by: str, decrement: float) -> None:
    for seed in range(5):
        _, system, start = problem(world, sigma=0.1, seed=seed, robot_model=robots_by)
        solution = optimise(system, start, Options(decrement=decrement, cost_share=0.0))
        at = system.linearise(solution.values)
        factor = system.factor(solution.values)
        factor.factorise(at.hessian.numbers)
        left = float(np.sqrt(at.gradient @ factor.solve(at.gradient)))
        assert solution.converged
        assert left <= decrement
        assert solution.decrement <= decrement


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("decrement", [1e-3, 1e-15])  # the second is beyond rounding, where a run ends without a step
def test_progress_hears_of_every_step_once(world: str, rule: str, decrement: float) -> None:
    _, system, start = problem(world, sigma=0.1)
    told: list[Step] = []
    solution = optimise(system, start, Options(rule=rule, decrement=decrement, cost_share=0.0), told.append)
    assert tuple(told) == solution.history


class Counting(Factor):
    """A factor that knows how often it was made anew."""

    made = 0

    def factorise(self, *given: Any) -> None:
        self.made += 1
        super().factorise(*given)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("rule", RULES)
def test_near_the_optimum_a_factor_serves_several_steps(world: str, rule: str) -> None:
    _, system, start = problem(world, sigma=0.1)
    factor = Counting(system.free, system.pattern)
    solution = optimise(system, start, Options(rule=rule, decrement=1e-8, cost_share=0.0), factor=factor)
    assert solution.status is Status.CONVERGED and solution.decrement <= 1e-8
    assert factor.made < solution.iterations
    near = [step.decrement for step in solution.history if step.decrement < 1.0]
    assert all(b < a for a, b in itertools.pairwise(near))


@pytest.mark.parametrize("rule", ["levenberg_marquardt", "dogleg"])
def test_a_bad_start_is_survived(rule: str) -> None:
    dataset, system, start = problem("planar")
    wild = system.retract(start, np.random.default_rng(5).normal(0.0, 0.6, system.free.dof))
    best = optimise(system, start)
    solution = optimise(system, wild, Options(rule=rule))
    assert solution.converged
    assert solution.cost == pytest.approx(best.cost, rel=1e-9)
    costs = [step.cost for step in solution.history if step.accepted]
    assert all(b <= a * (1 + 1e-9) for a, b in itertools.pairwise(costs))
    assert dataset.dof == solution.rows


def test_residuals_that_bend_are_solved_to_rounding() -> None:
    """Ranges with large residuals, of which Gauss-Newton leaves half the distance at each step and more."""
    dataset = team("2d", robots=3, robot_model="range", sigma=0.8, sigma_odometry=0.05, every=1, sees=0.2, seed=5)
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    system = System(start.layout, tables=dataset.tables, fixed=dataset.pose_keys[1][:1])
    solution = optimise(system, start, Options(decrement=1e-12, cost_share=0.0))
    assert solution.converged and solution.iterations <= 20
    at = system.linearise(solution.values, curvature="all")
    left = np.linalg.solve(at.hessian.to_csr().toarray(), at.gradient)
    assert np.abs(left).max() < 1e-11
    assert solution.information.toarray() == pytest.approx(system.linearise(solution.values).hessian.to_csr().toarray())


def test_the_information_is_that_of_the_estimate() -> None:
    _, system, start = problem("planar")
    solution = optimise(system, start)
    again = system.linearise(solution.values)
    np.testing.assert_array_equal(solution.information.toarray(), again.hessian.to_csr().toarray())
    assert solution.dof == solution.rows - system.free.dof
    assert solution.chi2 == pytest.approx(solution.cost)


def test_robust_chi2_counts_squares_whatever_the_loss() -> None:
    dataset, _, start = problem("planar", sigma=0.2)
    robust = dataset.with_loss(Loss("cauchy", 1.0))
    system = System(start.layout, tables=robust.tables, fixed=dataset.pose_keys[1][:1])
    solution = optimise(system, start)
    expected = sum(float(np.sum(t.whitened(solution.values) ** 2)) for t in robust.tables)
    assert solution.chi2 == pytest.approx(expected, rel=1e-9)
    assert solution.cost < solution.chi2


def test_an_unseen_variable_is_named() -> None:
    dataset = team("2d", robots=1, poses=4, landmarks=2)
    tables = [t for t in dataset.tables if t.source == "odometry"]
    assert dataset.truth is not None
    start = dataset.truth.only(dataset.layout.keys)
    system = System(start.layout, tables=tables, fixed=dataset.pose_keys[1][:1], names=dataset.names)
    with pytest.raises(SolveError, match="landmark 0 is not determined"):
        optimise(system, start)


def test_everything_fixed_is_said() -> None:
    dataset, _, start = problem("2d")
    system = System(start.layout, tables=dataset.tables, fixed=start.layout.keys)
    assert optimise(system, start).status is Status.EMPTY


def test_the_limit_of_iterations_is_not_success() -> None:
    _, system, start = problem("planar", sigma=0.3)
    wild = system.retract(start, np.random.default_rng(5).normal(0.0, 0.5, system.free.dof))
    solution = optimise(system, wild, Options(max_iterations=1))
    assert solution.status is Status.MAX_ITERATIONS
    assert not solution.converged


@pytest.mark.parametrize("bad", [{"rule": "newton"}, {"max_iterations": 0}, {"decrement": 0.0}])
def test_options_are_checked(bad: dict[str, object]) -> None:
    with pytest.raises(InputError):
        Options(**bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("world", WORLDS)
def test_covariances_are_the_dense_inverse(world: str) -> None:
    _, system, start = problem(world)
    solution = optimise(system, start)
    covariances = Covariances(system.free, solution.information)
    dense = np.linalg.inv(solution.information.toarray())
    keys = system.free.keys
    for key in keys:
        at = system.free.unknowns(np.array([key]))
        np.testing.assert_allclose(covariances.of(int(key)), dense[np.ix_(at, at)], rtol=1e-8, atol=1e-14)
    pair = keys[[0, -1]]
    at = system.free.unknowns(pair)
    np.testing.assert_allclose(covariances.joint(pair), dense[np.ix_(at, at)], rtol=1e-8, atol=1e-14)
    draws = covariances.draws(np.eye(system.free.dof))
    np.testing.assert_allclose(draws @ draws.T, dense, rtol=1e-8, atol=1e-14)


def test_joint_covariances_of_many_variables_are_the_dense_inverse() -> None:
    """In whatever order they are asked for, one of them twice; and of all there are."""
    rng = np.random.default_rng(0)
    layout = Layout.of(landmark_key(np.arange(3 * MANY)), np.repeat([Kind.POINT2, Kind.POINT3], [MANY, 2 * MANY]))
    root = sp.random_array((2 * layout.dof, layout.dof), density=0.02, rng=rng, data_sampler=rng.standard_normal)
    information = sp.csr_array(root.T @ root + sp.eye_array(layout.dof))
    covariances, dense = Covariances(layout, information), np.linalg.inv(information.toarray())
    for asked in (np.append(layout.keys[::-2], layout.keys[-1]), rng.permutation(layout.keys)):
        at = layout.unknowns(asked)
        np.testing.assert_allclose(covariances.joint(asked), dense[np.ix_(at, at)], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("world", WORLDS)
def test_relative_covariance_is_propagated(world: str) -> None:
    """cov(f) = J joint J' with J of the relative thing by differences: an independent derivative."""
    dataset, system, start = problem(world)
    solution = optimise(system, start)
    covariances = Covariances(system.free, solution.information)
    observer = int(dataset.pose_keys[1][2])
    for target in (int(dataset.pose_keys[2][3]), int(dataset.landmark_keys[1])):
        joint = covariances.joint(np.array([observer, target]))
        at = system.free.unknowns(np.array([observer, target]))
        columns = []
        for unknown in at:
            step = np.zeros(system.free.dof)
            step[unknown] = 1e-6
            ahead, behind = (seen(system.retract(solution.values, s), observer, target) for s in (step, -step))
            columns.append((ahead[0].minus(behind[0]) if target >> 51 else ahead[1] - behind[1]) / 2e-6)
        j = np.stack(columns, -1)
        found = covariances.relative(solution.values, observer, target)
        np.testing.assert_allclose(found, j @ joint @ j.T, rtol=1e-5, atol=1e-12)


def seen(values: Values, observer: int, target: int):  # type: ignore[no-untyped-def]
    pose = values.pose(observer)
    if target >> 51:
        return pose.between(values.pose(target)), None
    dim = 2 if pose.dim == 2 and values.layout.kinds[values.layout.index(target)] == 2 else 3
    return None, pose.lift(dim).unact(values.positions(np.array([target]), dim)[0])


def test_a_solution_does_not_keep_the_factor_of_its_solve() -> None:
    _, system, start = problem("3d", sigma=0.1)
    factor = system.factor(start)
    kept = weakref.ref(factor)
    solution = optimise(system, start, factor=factor)
    del factor
    assert kept() is None
    assert solution.hessian.numbers.shape == (system.pattern.size,)


@pytest.mark.parametrize("world", WORLDS)
def test_rows_are_counted_whether_they_share_their_noise_or_not(world: str) -> None:
    dataset, _, _ = problem(world)
    for table in dataset.tables:
        each = replace(table, whitening=np.repeat(table.whitening[:1], len(table), 0))
        shared = replace(table, whitening=table.whitening[:1])
        assert table.select(np.arange(0)).dof == 0
        assert each.dof == shared.dof == int(shared.ranks.sum()) == len(table) * table.whitening.shape[-1]
