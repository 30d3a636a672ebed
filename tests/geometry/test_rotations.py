"""Laws of SO(2) and SO(3) for any batch; SciPy's Rotation and matrix exponential as oracles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from strategies import AWKWARD_ANGLES, NEAR_PI, batches, dims, generators, rotation_vectors, unit_vectors
from teamslam.errors import ModelError
from teamslam.geometry import Array, rotations, so3


@given(st.data(), dims, batches)
def test_exp_gives_rotations(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    rotation = rotations(dim).exp(data.draw(rotation_vectors(dim, batch)))
    assert rotation.shape == (*batch, dim, dim)
    assert_allclose(rotation @ np.swapaxes(rotation, -1, -2), np.broadcast_to(np.eye(dim), rotation.shape), atol=1e-14)
    assert_allclose(np.linalg.det(rotation), np.ones(batch), atol=1e-14)


@given(st.data(), dims, batches)
def test_log_undoes_exp(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    w = data.draw(rotation_vectors(dim, batch))
    again = rotations(dim).log(rotations(dim).exp(w))
    assert again.shape == w.shape
    assert_allclose(again, w, atol=1e-13)


@given(st.data(), dims, batches)
def test_exp_undoes_log(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    group = rotations(dim)
    rotation = group.exp(data.draw(rotation_vectors(dim, batch))) @ group.exp(data.draw(rotation_vectors(dim, batch)))
    assert_allclose(group.exp(group.log(rotation)), rotation, atol=1e-14)


@given(st.data(), batches)
def test_exp_and_log_agree_with_scipy_in_space(data: st.DataObject, batch: tuple[int, ...]) -> None:
    w = data.draw(rotation_vectors(3, batch))
    oracle = Rotation.from_rotvec(w.reshape(-1, 3)) if w.size else None
    if oracle is not None:
        assert_allclose(so3.exp(w).reshape(-1, 3, 3), oracle.as_matrix(), atol=1e-14)
        assert_allclose(so3.log(so3.exp(w)).reshape(-1, 3), oracle.as_rotvec(), atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angle", [*AWKWARD_ANGLES, *NEAR_PI, 4.0, 7.0])
def test_exp_is_the_matrix_exponential_of_hat(dim: int, angle: float) -> None:
    group = rotations(dim)
    for w in angle * unit_vectors(np.random.default_rng(1), group.DOF, (5,)):
        assert_allclose(group.exp(w), expm(group.hat(w)), atol=1e-13)


@given(generators, dims, batches)
def test_hat_is_the_slope_of_exp(rng: np.random.Generator, dim: int, batch: tuple[int, ...]) -> None:
    group = rotations(dim)
    w = rng.normal(size=(*batch, group.DOF))
    assert_allclose((group.exp(1e-6 * w) - group.exp(-1e-6 * w)) / 2e-6, group.hat(w), atol=1e-8)
    if dim == 3:
        p = rng.normal(size=(*batch, 3))
        assert_allclose((group.hat(w) @ p[..., None])[..., 0], np.cross(w, p), atol=1e-14)


@given(st.data(), batches)
def test_log_at_a_half_turn_is_the_axis_up_to_its_sign(data: st.DataObject, batch: tuple[int, ...]) -> None:
    axis = unit_vectors(data.draw(generators), 3, batch)
    w = so3.log(so3.exp(np.pi * axis))
    assert_allclose(np.linalg.norm(w, axis=-1), np.full(batch, np.pi), atol=1e-12)
    assert_allclose(np.abs(np.sum(w * axis, -1)), np.full(batch, np.pi), atol=1e-12)


@pytest.mark.parametrize("diagonal", [(1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
def test_log_of_exact_half_turns_about_the_axes(diagonal: tuple[int, int, int]) -> None:
    assert_allclose(np.abs(so3.log(np.diag(diagonal).astype(float))), np.pi * (np.array(diagonal) == 1), atol=1e-15)


def test_log_in_the_plane_is_within_minus_pi_and_pi() -> None:
    group = rotations(2)
    turns = np.linspace(-20.0, 20.0, 1001)[:, None]
    w = group.log(group.exp(turns))
    assert (np.abs(w) <= np.pi).all()
    assert_allclose(np.cos(w - turns), np.ones_like(w), atol=1e-12)


@given(st.data(), dims, batches)
def test_right_jacobian_against_central_differences(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    """Exp(w + d) ~ Exp(w) Exp(Jr d)."""
    group = rotations(dim)
    w = data.draw(rotation_vectors(dim, batch))
    back = np.swapaxes(group.exp(w), -1, -2)
    numeric = _central(lambda d: group.log(back @ group.exp(w + d)), group.DOF, batch)
    assert group.right_jacobian(w).shape == (*batch, group.DOF, group.DOF)
    assert_allclose(group.right_jacobian(w), numeric, atol=1e-9)


@given(st.data(), dims, batches)
def test_inverse_right_jacobian_against_central_differences(
    data: st.DataObject, dim: int, batch: tuple[int, ...]
) -> None:
    """Log(Exp(w) Exp(d)) ~ w + Jr^-1 d, away from the jump of Log at pi."""
    group = rotations(dim)
    w = data.draw(rotation_vectors(dim, batch, near_pi=False))
    numeric = _central(lambda d: group.log(group.exp(w) @ group.exp(d)), group.DOF, batch)
    assert_allclose(group.right_jacobian_inverse(w), numeric, atol=1e-8)


@given(st.data(), dims, batches)
def test_the_two_right_jacobians_are_inverse(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    group = rotations(dim)
    w = data.draw(rotation_vectors(dim, batch))
    product = group.right_jacobian(w) @ group.right_jacobian_inverse(w)
    assert_allclose(product, np.broadcast_to(np.eye(group.DOF), product.shape), atol=1e-11)


@given(st.data(), dims, batches)
def test_adjoint_moves_a_turn_to_the_other_side(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    """R Exp(w) R' = Exp(A w)."""
    group = rotations(dim)
    rotation = group.exp(data.draw(rotation_vectors(dim, batch)))
    w = data.draw(rotation_vectors(dim, batch))
    moved = (group.adjoint(rotation) @ w[..., None])[..., 0]
    assert_allclose(rotation @ group.exp(w) @ np.swapaxes(rotation, -1, -2), group.exp(moved), atol=1e-13)


@pytest.mark.parametrize("dim", [0, 1, 4])
def test_no_other_dimension_has_rotations_here(dim: int) -> None:
    with pytest.raises(ModelError, match="plane"):
        rotations(dim)


def _central(function, dof: int, batch: tuple[int, ...], step: float = 1e-5) -> Array:
    """The Jacobian (..., n, dof) of function(d) at d = 0, by central differences."""
    columns = []
    for k in range(dof):
        d = np.zeros((*batch, dof))
        d[..., k] = step
        columns.append((function(d) - function(-d)) / (2.0 * step))
    return np.stack(columns, -1)
