"""Directions of the plane and of space: the same laws for both."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies import generators
from teamslam.errors import ModelError
from teamslam.geometry import directions

dims = st.sampled_from([2, 3])


@given(generators, dims)
def test_a_direction_survives_its_rays_and_its_angles(rng: np.random.Generator, dim: int) -> None:
    """of(ray(z)) = z = of_angles(angles(z)), of any batch; a ray has length 1."""
    sphere = directions(dim)
    z = sphere.of(rng.normal(size=(2, 5, dim)))
    assert z.shape == (2, 5, sphere.SIZE) and sphere.angles(z).shape == (2, 5, sphere.DOF)
    np.testing.assert_allclose(np.linalg.norm(sphere.ray(z), axis=-1), 1.0)
    np.testing.assert_allclose(sphere.of(sphere.ray(z)), z, atol=1e-12)
    np.testing.assert_allclose(sphere.of_angles(sphere.angles(z)), z, atol=1e-12)


@given(generators, dims)
def test_a_basis_is_where_a_direction_goes_as_its_angles_rise(rng: np.random.Generator, dim: int) -> None:
    """Orthonormal, square to the ray, and a small way along it is as much of the angle (of azimuth: times cos)."""
    sphere = directions(dim)
    rays = sphere.ray(sphere.of(rng.normal(size=(2, 5, dim))))
    basis = sphere.direction_basis(rays)
    assert basis.shape == (2, 5, dim, sphere.DOF)
    np.testing.assert_allclose(
        np.swapaxes(basis, -1, -2) @ basis,
        np.broadcast_to(np.eye(sphere.DOF), (2, 5, *basis.shape[-1:] * 2)),
        atol=1e-12,
    )
    np.testing.assert_allclose(np.swapaxes(basis, -1, -2) @ rays[..., None], 0.0, atol=1e-12)
    step = 1e-6
    up = sphere.minus(sphere.of(rays + step * basis[..., -1]), sphere.of(rays))[..., -1]
    np.testing.assert_allclose(up, step, rtol=1e-4)


@given(generators, dims)
def test_what_is_added_is_the_difference(rng: np.random.Generator, dim: int) -> None:
    """minus(plus(h, n), h) = n, but near the poles of the sphere."""
    sphere = directions(dim)
    h = sphere.of(rng.normal(size=(20, dim)))
    h = h[np.abs(sphere.angles(h)[:, -1]) < 1.0] if dim == 3 else h
    n = rng.uniform(-0.3, 0.3, (len(h), sphere.DOF))
    np.testing.assert_allclose(sphere.minus(sphere.plus(h, n), h), n, atol=1e-9)
    np.testing.assert_allclose(sphere.minus(h, h), 0.0, atol=1e-12)


@given(generators, dims)
def test_what_is_opposite_is_half_a_turn_away(rng: np.random.Generator, dim: int) -> None:
    sphere = directions(dim)
    rays = rng.normal(size=(20, dim))
    apart = sphere.minus(sphere.of(rays), sphere.of(-rays))
    np.testing.assert_allclose(np.linalg.norm(apart, axis=-1), np.pi, atol=1e-9)


@given(generators, dims, st.floats(0.1, 6.2))
def test_a_cone_holds_its_rays(rng: np.random.Generator, dim: int, angle: float) -> None:
    rays = directions(dim).cone(50, angle, rng)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    assert (np.arccos(np.clip(rays[:, 0], -1.0, 1.0)) <= 0.5 * angle + 1e-9).all()


def test_there_are_two_kinds_of_space() -> None:
    with pytest.raises(ModelError, match="dimension 4"):
        directions(4)
