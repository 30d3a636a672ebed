"""Noise in the sensors' own coordinates: (h (+) n) (-) h = n for every sensor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.model import MODELS, Model
from teamslam.sim import NOISES, noise
from teamslam.sim.view import anywhere_in_view


def predictions(model: str, dim: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """What a sensor would report of targets between 1 and 6 m away."""
    target = anywhere_in_view(count, dim, 5.0, 2.0 * np.pi, rng)
    far = target.translation * (1.0 + 1.0 / np.linalg.norm(target.translation, axis=-1, keepdims=True))
    eye = Pose.identity(dim, (count,))
    seen = Pose(target.rotation, far) if MODELS[model].targets_pose else far
    given = (rng.normal(size=(count, MODELS[model].given)),) if MODELS[model].given else ()
    return MODELS[model].predict(eye, seen, dim, *given)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", MODELS)
@given(seed=st.integers(0, 10_000), scale=st.floats(1e-9, 0.3))
def test_noise_is_the_residual(model: str, dim: int, seed: int, scale: float) -> None:
    """What is drawn is what an estimator at the truth sees."""
    if not MODELS[model].z_size(dim):
        return
    rng = np.random.default_rng(seed)
    h = predictions(model, dim, 40, rng)
    n = np.clip(scale * rng.standard_normal((len(h), MODELS[model].residual_rows(dim))), -0.4, 0.4)
    if model in ("bearing", "range_bearing") and dim == 3:
        away = np.abs(h[:, -1]) < np.cos(np.linalg.norm(n[:, -2:], axis=-1) + 0.01)  # of the poles: see below
        h, n = h[away], n[away]
    if model == "corners":
        rays = np.abs(h[:, 2:12:3]) < np.cos(np.linalg.norm(n.reshape(-1, 4, 2), axis=-1) + 0.01)
        h, n = h[rays.all(1)], n[rays.all(1)]
    z = noise.plus(model, h, n, dim)
    assert np.allclose(MODELS[model].minus(z, h, dim), n, atol=1e-9)


def test_every_built_in_sensor_has_its_noise() -> None:
    """A new row of MODELS without noise is found here."""
    assert set(NOISES) == set(MODELS)
    for name, row in NOISES.items():
        for dim in (2, 3):
            assert len(noise.sigmas(name, dim, 0.1, 0.2)) == MODELS[name].residual_rows(dim)
            assert (noise.sigmas(name, dim, 0.1, 0.2) == 0.2).sum() == row.angles[dim - 2]


def test_directions_near_the_pole_keep_their_angle() -> None:
    """Azimuth turns fast there, but the distance on the sphere is still that of the noise."""
    h = np.array([[1e-3, 0.0, 1.0], [0.0, 0.0, 1.0], [0.02, 0.01, -1.0], [0.03, 0.0, -1.0]])
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    n = np.array([[0.02, 0.03], [0.02, 0.03], [0.02, -0.03], [0.03, 0.0]])
    z = noise.plus("bearing", h, n, 3)
    assert np.allclose(np.linalg.norm(z, axis=-1), 1.0)
    assert np.allclose(np.arccos(np.sum(z * h, -1)), np.linalg.norm(n, axis=-1), atol=1e-9)


def test_no_range_is_reported_below_zero() -> None:
    """Whatever the noise."""
    h, n = np.full((1000, 1), 0.05), np.random.default_rng(0).normal(0.0, 0.5, (1000, 1))
    assert (noise.plus("range", h, n, 2) > 0.0).all()


def test_a_sensor_of_ones_own_adds_or_says_that_it_needs_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain numbers add; anything else is refused instead of being simulated wrongly."""
    point = MODELS["point"]
    monkeypatch.setitem(MODELS, "mine", point)
    h, n = np.ones((3, 2)), np.full((3, 2), 0.1)
    assert np.allclose(noise.plus("mine", h, n, 2), 1.1)
    monkeypatch.setitem(MODELS, "odd", Model(point.predict, lambda z, h, dim: 2.0 * (z - h), (2, 3), (2, 3)))
    with pytest.raises(InputError, match="NOISES"):
        noise.plus("odd", h, n, 2)
    with pytest.raises(InputError, match="sigmas"):
        noise.sigmas("odd", 2, 0.1, 0.1)
