"""Laws of poses in the plane and in space, for any batch; SciPy's RigidTransform and Rotation as oracles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from strategies import batches, dims, generators, poses, random_poses, rotation_vectors
from teamslam.errors import ModelError
from teamslam.geometry import Pose, concatenate, lift_points, lift_tangent


def assert_same(a: Pose, b: Pose, atol: float = 1e-12) -> None:
    assert a.dim == b.dim and a.batch == b.batch
    assert_allclose(a.rotation, b.rotation, atol=atol)
    assert_allclose(a.translation, b.translation, atol=atol)


# --- the group ------------------------------------------------------------------------------------------------------


@given(st.data(), dims, batches)
def test_group_axioms(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    a, b, c = (data.draw(poses(dim, batch)) for _ in range(3))
    one = Pose.identity(dim, batch)
    assert_same((a @ b) @ c, a @ (b @ c), 1e-11)
    assert_same(a @ one, a)
    assert_same(one @ a, a)
    assert_same(a @ a.inverse(), one)
    assert_same(a.inverse() @ a, one)
    assert_same((a @ b).inverse(), b.inverse() @ a.inverse(), 1e-11)
    assert_same(a.between(b), a.inverse() @ b)
    assert_same(a @ a.between(b), b, 1e-11)


@given(st.data(), dims, batches)
def test_composition_acts_as_one_after_the_other(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    a, b = data.draw(poses(dim, batch)), data.draw(poses(dim, batch))
    p = data.draw(generators).normal(scale=5.0, size=(*batch, dim))
    assert_allclose((a @ b).act(p), a.act(b.act(p)), atol=1e-11)
    assert_allclose(a.unact(a.act(p)), p, atol=1e-12)
    assert_allclose(a.unact(p), a.inverse().act(p), atol=1e-12)


@given(st.data(), batches)
def test_composition_agrees_with_scipy(data: st.DataObject, batch: tuple[int, ...]) -> None:
    a, b = data.draw(poses(3, batch)), data.draw(poses(3, batch))
    if a.translation.size:
        oracle = [
            RigidTransform.from_components(
                x.translation.reshape(-1, 3), Rotation.from_matrix(x.rotation.reshape(-1, 3, 3))
            )
            for x in (a, b)
        ]
        product = (oracle[0] * oracle[1]).as_matrix()
        assert_allclose((a @ b).rotation.reshape(-1, 3, 3), product[:, :3, :3], atol=1e-13)
        assert_allclose((a @ b).translation.reshape(-1, 3), product[:, :3, 3], atol=1e-12)


@given(generators, dims)
def test_one_pose_broadcasts_against_many(rng: np.random.Generator, dim: int) -> None:
    one, many = random_poses(rng, dim), random_poses(rng, dim, 4, 3)
    product = one @ many
    for i, j in np.ndindex(4, 3):
        assert_same(product[i, j], one @ many[i, j])
    assert one.act(rng.normal(size=(7, dim))).shape == (7, dim)


@given(st.data(), dims, batches)
def test_adjoint_moves_a_small_motion_to_the_other_side(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    """X (I (+) d) X^-1 ~ I (+) A d to first order: A against central differences."""
    x = data.draw(poses(dim, batch))
    one, back, step = Pose.identity(dim, batch), x.inverse(), 1e-5
    adjoint = x.adjoint()
    assert adjoint.shape == (*batch, x.dof, x.dof)
    for k in range(x.dof):
        d = np.zeros((*batch, x.dof))
        d[..., k] = step
        slope = ((x @ one.retract(d) @ back).minus(one) - (x @ one.retract(-d) @ back).minus(one)) / (2 * step)
        assert_allclose(adjoint[..., k], slope, atol=1e-7)


@given(st.data(), dims, batches)
def test_adjoint_is_a_homomorphism(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    a, b = data.draw(poses(dim, batch)), data.draw(poses(dim, batch))
    assert_allclose((a @ b).adjoint(), a.adjoint() @ b.adjoint(), atol=1e-10)


# --- the chart ------------------------------------------------------------------------------------------------------


@given(st.data(), dims, batches)
def test_minus_undoes_retract(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    """(X (+) d) (-) X = d."""
    x = data.draw(poses(dim, batch))
    d = np.concatenate([data.draw(generators).normal(size=(*batch, dim)), data.draw(rotation_vectors(dim, batch))], -1)
    assert_allclose(x.retract(d).minus(x), d, atol=1e-12)


@given(st.data(), dims, batches)
def test_retract_undoes_minus(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    """a (+) (b (-) a) = b, and b (-) a = -(a (-) b)."""
    a, b = data.draw(poses(dim, batch)), data.draw(poses(dim, batch))
    assert_same(a.retract(b.minus(a)), b)
    assert_same(Pose.from_tangent(a.minus(Pose.identity(dim, batch)), dim), a)
    assert a.minus(b).shape == (*batch, a.dof)
    assert_allclose(a.minus(a), np.zeros((*batch, a.dof)), atol=1e-15)


@given(st.data(), dims, batches)
def test_minus_changes_sign_when_swapped(data: st.DataObject, dim: int, batch: tuple[int, ...]) -> None:
    a = data.draw(poses(dim, batch))
    b = a.retract(0.3 * data.draw(generators).normal(size=(*batch, a.dof)))
    assert_allclose(a.minus(b), -b.minus(a), atol=1e-12)


def test_the_translation_is_added_in_the_frame_the_pose_is_written_in() -> None:
    x = Pose.from_xytheta(np.array([1.0, 2.0, np.pi / 2]))
    assert_allclose(x.retract(np.array([0.5, 0.0, 0.0])).translation, [1.5, 2.0])


# --- plane and space ------------------------------------------------------------------------------------------------


@given(st.data(), batches)
def test_lifting_to_space_keeps_composition_and_action(data: st.DataObject, batch: tuple[int, ...]) -> None:
    a, b = data.draw(poses(2, batch)), data.draw(poses(2, batch))
    p = data.draw(generators).normal(size=(*batch, 2))
    assert_same((a @ b).lift(3), a.lift(3) @ b.lift(3))
    assert_same(a.inverse().lift(3), a.lift(3).inverse())
    assert_allclose(a.lift(3).act(lift_points(p, 3)), lift_points(a.act(p), 3), atol=1e-13)
    assert_same(a @ b.lift(3), a.lift(3) @ b.lift(3))
    assert_same(a.lift(3) @ b, a.lift(3) @ b.lift(3))
    assert a.lift(2) is a


@given(st.data(), batches)
def test_lifting_keeps_the_chart(data: st.DataObject, batch: tuple[int, ...]) -> None:
    """(X (+) d).lift = X.lift (+) E d, and E'(a.lift (-) b.lift) = a (-) b."""
    a, b, e = data.draw(poses(2, batch)), data.draw(poses(2, batch)), lift_tangent(2, 3)
    d = data.draw(generators).normal(size=(*batch, 3))
    assert_same(a.retract(d).lift(3), a.lift(3).retract(d @ e.T))
    assert_allclose(a.lift(3).minus(b.lift(3)) @ e, a.minus(b), atol=1e-12)
    assert_allclose(e.T @ e, np.eye(3))


@pytest.mark.parametrize("dim", [2, 3])
def test_lifting_to_where_it_lives_changes_nothing(dim: int) -> None:
    points = np.random.default_rng(0).normal(size=(4, dim))
    assert_allclose(lift_points(points, dim), points)
    assert_allclose(lift_tangent(dim, dim), np.eye(3 if dim == 2 else 6))


def test_what_would_lose_height_is_refused() -> None:
    with pytest.raises(ModelError, match="without loss"):
        Pose.identity(3).lift(2)
    with pytest.raises(ModelError, match="without loss"):
        lift_points(np.zeros((1, 3)), 2)


# --- making and reading poses ---------------------------------------------------------------------------------------


@given(st.data(), batches)
def test_quaternions_round_trip_and_agree_with_scipy(data: st.DataObject, batch: tuple[int, ...]) -> None:
    x = data.draw(poses(3, batch))
    q = x.quaternion_wxyz()
    assert_allclose(np.linalg.norm(q, axis=-1), np.ones(batch), atol=1e-13)
    assert (q[..., 0] >= -1e-15).all()
    assert_same(Pose.from_quaternion(x.translation, q), x)
    length = data.draw(st.floats(0.1, 10.0)) * data.draw(st.sampled_from([-1.0, 1.0]))
    assert_same(Pose.from_quaternion(x.translation, length * q), x)
    if q.size:
        oracle = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix()
        assert_allclose(x.rotation.reshape(-1, 3, 3), oracle, atol=1e-13)


def test_a_quaternion_of_length_zero_is_refused() -> None:
    with pytest.raises(ModelError, match="zero"):
        Pose.from_quaternion(np.zeros(3), np.zeros(4))


@given(st.data(), batches)
def test_xytheta_round_trips(data: st.DataObject, batch: tuple[int, ...]) -> None:
    x = data.draw(poses(2, batch))
    assert_same(Pose.from_xytheta(x.xytheta()), x)
    assert_allclose(x.lift(3).xytheta(), x.xytheta(), atol=1e-14)
    assert_allclose(x.quaternion_wxyz(), x.lift(3).quaternion_wxyz())
    planar_quaternion = np.stack([np.cos(x.heading / 2), *np.zeros((2, *batch)), np.sin(x.heading / 2)], -1)
    assert_allclose(x.quaternion_wxyz(), planar_quaternion, atol=1e-13)


def test_heading_is_the_angle_of_the_forward_axis_on_the_ground() -> None:
    tilted = Pose(Rotation.from_euler("ZYX", [0.7, 0.4, -0.2]).as_matrix(), np.zeros(3))
    assert_allclose(tilted.heading, 0.7)


@given(generators, dims)
def test_indexing_and_concatenating_poses(rng: np.random.Generator, dim: int) -> None:
    x = random_poses(rng, dim, 5)
    assert len(x) == 5 and x.batch == (5,)
    assert_same(concatenate([x[:2], x[2:4], x[np.array([4])]]), x)
    assert x[1].batch == () and x[None].batch == (1, 5)


def test_a_pose_needs_one_batch_shape() -> None:
    with pytest.raises(ModelError, match="batch shape"):
        Pose(np.eye(2), np.zeros((3, 2)))
    with pytest.raises(ModelError, match="batch shape"):
        Pose(np.eye(3), np.zeros(2))
    with pytest.raises(ModelError, match="dimension 4"):
        Pose(np.eye(4), np.zeros(4))


def test_poses_copy_what_they_are_made_of() -> None:
    xytheta = np.array([1.0, 2.0, 3.0])
    x = Pose.from_xytheta(xytheta)
    xytheta[:] = 0.0
    assert_allclose(x.translation, [1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        x.translation[0] = 5.0
