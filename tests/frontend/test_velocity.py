"""Held velocities: arcs against a fine integration, increments that compose, covariances against sampled noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from teamslam.frontend.velocity import VelocityNoise, integrate
from teamslam.geometry import Array, Pose
from teamslam.model import whitening

NOISE = VelocityNoise(0.02, 0.005, 0.03, 0.01, 0.002, 0.01, 0.05)


def drive(seed: int, count: int = 8) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.integers(1_000, 700_000, count))
    return stamps, np.stack([rng.uniform(-0.5, 0.5, count), rng.choice([0.0, 1e-9, -0.4, 0.8], count)], -1)


@given(st.integers(0, 10_000))
def test_arcs_are_the_solution_of_the_motion_s_equation(seed: int) -> None:
    stamps, velocities = drive(seed, 3)
    end = int(stamps[-1]) + 300_000
    found, _ = integrate(stamps, velocities, np.array([stamps[0], end]), NOISE)
    state = np.zeros(3)
    for (v, w), start, stop in zip(velocities, stamps, [*stamps[1:], end], strict=True):
        state = solve_ivp(
            lambda t, x, v=v, w=w: [v * np.cos(x[2]), v * np.sin(x[2]), w],
            (0.0, (stop - start) * 1e-6), state, rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
    assert np.allclose(found[0], state, atol=1e-8)


@given(st.integers(0, 10_000))
def test_increments_compose_to_the_whole_wherever_a_way_is_cut(seed: int) -> None:
    stamps, velocities = drive(seed)
    rng = np.random.default_rng(seed)
    cuts = np.unique(np.concatenate([stamps[[0, -1]], rng.integers(stamps[0], stamps[-1], 5)]))
    whole, covariance = integrate(stamps, velocities, cuts[[0, -1]], NOISE)
    parts, covariances = integrate(stamps, velocities, cuts, NOISE)
    pose, joint = Pose.identity(2), np.zeros((3, 3))
    for part, noise in zip(Pose.from_xytheta(parts), covariances, strict=True):
        # Noise so far is swung by the part's way, the part's own noise is turned into the first frame.
        swing, turn = np.eye(3), np.eye(3)
        step = pose.rotation @ part.translation
        swing[:2, 2] = [-step[1], step[0]]
        turn[:2, :2] = pose.rotation
        joint = swing @ joint @ swing.T + turn @ noise @ turn.T
        pose = pose @ part
    assert np.allclose(pose.minus(Pose.from_xytheta(whole[0])), 0.0, atol=1e-12)
    # Arcs cut at other places are integrated by quadrature at other places.
    scale = np.sqrt(np.diag(covariance[0]))
    assert np.abs((joint - covariance[0]) / np.outer(scale, scale)).max() < 1e-3


def test_covariance_is_that_of_sampled_noise() -> None:
    stamps, velocities = np.array([0, 1_000_000]), np.array([[0.5, 0.3], [0.2, -0.6]])
    _, covariance = integrate(stamps, velocities, np.array([0, 2_000_000]), NOISE)
    rng, runs, dt = np.random.default_rng(0), 20_000, 0.02
    x = np.zeros((runs, 3))
    for k in range(100):
        v, w = velocities[k // 50]
        n = rng.normal(size=(runs, 3)) * np.sqrt(NOISE.densities(v, w) / dt)
        middle = x[:, 2] + 0.5 * dt * (w + n[:, 2])
        c, s = np.cos(middle), np.sin(middle)
        x[:, 0] += dt * (c * (v + n[:, 0]) - s * n[:, 1])
        x[:, 1] += dt * (s * (v + n[:, 0]) + c * n[:, 1])
        x[:, 2] += dt * (w + n[:, 2])
    sampled = np.cov(x.T)
    scale = np.sqrt(np.diag(covariance[0]))
    # 20,000 samples: correlations and variances to about 1 %, plus what is beyond first order.
    assert np.abs((sampled - covariance[0]) / np.outer(scale, scale)).max() < 0.04


@given(st.integers(0, 10_000))
def test_every_increment_has_a_covariance(seed: int) -> None:
    stamps, velocities = drive(seed)
    velocities[::2] = 0.0  # at rest too
    at = np.arange(stamps[0], stamps[-1], 20_000)
    _, covariances = integrate(stamps, velocities, at, VelocityNoise(0.01, 0.001, 0.001))
    whitening(covariances)


def test_nothing_to_integrate() -> None:
    stamps, velocities = drive(0)
    for at in (np.zeros(0, np.int64), stamps[:1]):
        increments, covariances = integrate(stamps, velocities, at, NOISE)
        assert increments.shape == (0, 3) and covariances.shape == (0, 3, 3)


@pytest.mark.parametrize("tick_s", [1e-6, 1e-3])
def test_a_tick_is_as_long_as_it_is_said_to_be(tick_s: float) -> None:
    increments, _ = integrate(np.array([0]), np.array([[2.0, 0.0]]), np.array([0, 500]), NOISE, tick_s=tick_s)
    assert np.allclose(increments, [[1000 * tick_s, 0.0, 0.0]])
