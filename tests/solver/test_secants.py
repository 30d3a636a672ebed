"""Secants: laws of the steps that a factor gives once it has grown old."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from teamslam.model import Kind, Layout
from teamslam.solver import Factor
from teamslam.solver.secants import Secants


def positive(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return root @ root.T + np.eye(n)


def aged(seed: int, points: int = 2) -> tuple[np.random.Generator, np.ndarray, Factor, int]:
    """A matrix, and the factor of another one."""
    rng, n = np.random.default_rng(seed), 2 * points
    layout = Layout.of(np.arange(1, points + 1), np.full(points, int(Kind.POINT2)))
    return rng, positive(rng, n), Factor.of(layout, sp.csr_array(positive(rng, n))), n


@given(st.integers(0, 10_000))
def test_the_last_step_is_what_its_change_of_gradient_gives(seed: int) -> None:
    rng, H, factor, n = aged(seed)
    secants = Secants()
    for _ in range(3):
        step, gradient = rng.normal(size=(2, n))
        secants.see(1e3, step, gradient, gradient - H @ step)
    found = secants.step(factor, H @ step)
    assert found is not None and found.is_full
    np.testing.assert_allclose(found.delta, step, rtol=1e-8, atol=1e-8)


@given(st.integers(0, 10_000))
def test_conjugate_steps_teach_it_the_whole_matrix(seed: int) -> None:
    rng, H, factor, n = aged(seed)
    secants = Secants()
    for step in np.linalg.inv(np.linalg.cholesky(H)):  # rows: conjugate, since L^-1 H L^-T = 1
        secants.see(1e3, step, np.zeros(n), -H @ step)
    gradient = rng.normal(size=n)
    found = secants.step(factor, gradient)
    assert found is not None
    np.testing.assert_allclose(found.delta, np.linalg.solve(H, gradient), rtol=1e-6, atol=1e-8)
    assert found.predicted == pytest.approx(gradient @ np.linalg.solve(H, gradient), rel=1e-6)


@given(st.integers(0, 10_000))
def test_what_bends_down_teaches_nothing_and_steps_go_down(seed: int) -> None:
    rng, H, factor, n = aged(seed)
    secants = Secants()
    step, gradient = rng.normal(size=(2, n))
    secants.see(1e3, step, np.zeros(n), H @ step)
    found = secants.step(factor, gradient)
    assert found is not None and found.predicted > 0.0
    np.testing.assert_allclose(found.delta, factor.solve(gradient), rtol=1e-12)


def test_a_factor_with_which_steps_hardly_come_nearer_serves_no_longer() -> None:
    _, _, factor, n = aged(0)
    secants, gradient = Secants(), np.ones(n)
    far = float(np.sqrt(gradient @ factor.solve(gradient)))
    taken = 0
    while secants.step(factor, gradient) is not None:
        secants.see(far, np.zeros(n), gradient, gradient)
        taken += 1
        assert taken < 100
    assert taken > 1
    secants.begin()
    assert secants.step(factor, gradient) is not None
