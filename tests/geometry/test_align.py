"""Laws of the rigid fit: it recovers an exact motion, it is the least squares optimum, and it says how firm it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from strategies import dims, generators, random_poses
from teamslam.errors import ModelError
from teamslam.geometry import Array, Pose, Told, align, register, rotations, turns_apart

AMOUNTS = st.integers(4, 12)


def assert_same(a: Pose, b: Pose, atol: float = 1e-9) -> None:
    assert_allclose(a.rotation, b.rotation, atol=atol)
    assert_allclose(a.translation, b.translation, atol=atol)


@given(generators, dims, AMOUNTS)
def test_an_exact_motion_is_recovered(rng: np.random.Generator, dim: int, n: int) -> None:
    """target = X.act(source)  =>  fit = X, whatever the weights."""
    x, source = random_poses(rng, dim, turn=3.1), rng.normal(scale=3.0, size=(n, dim))
    for weights in (None, rng.uniform(0.1, 10.0, n)):
        fit = align(source, x.act(source), weights)
        assert_same(fit.pose, x)
        assert fit.rms < 1e-12
        assert fit.rigidity > 0.0


@given(generators, dims, AMOUNTS)
def test_the_fit_is_the_least_squares_optimum(rng: np.random.Generator, dim: int, n: int) -> None:
    """No small motion makes a noisy weighted fit better, rotations included."""
    x = random_poses(rng, dim)
    source, weights, kappa = rng.normal(scale=3.0, size=(n, dim)), rng.uniform(0.1, 2.0, n), 0.7
    target = x.act(source) + 0.3 * rng.normal(size=(n, dim))
    source_poses = random_poses(rng, dim, 3)
    target_poses = (x @ source_poses).retract(0.2 * rng.normal(size=(3, x.dof)))

    def cost(pose: Pose) -> float:
        points = weights / weights.sum() @ np.sum((target - pose.act(source)) ** 2, -1)
        turns = np.sum((target_poses.rotation - pose.rotation @ source_poses.rotation) ** 2, (-2, -1)).mean()
        return float(points + kappa * turns)

    best = align(
        source,
        target,
        weights,
        source_rotations=source_poses.rotation,
        target_rotations=target_poses.rotation,
        kappa=kappa,
    ).pose
    for step in (1e-3, 1e-1, 1.0):
        for d in np.concatenate([np.eye(x.dof), -np.eye(x.dof)]):
            assert cost(best) <= cost(best.retract(step * d)) + 1e-12


@given(generators, AMOUNTS)
def test_weighted_fit_agrees_with_scipy(rng: np.random.Generator, n: int) -> None:
    source, weights = rng.normal(scale=3.0, size=(n, 3)), rng.uniform(0.1, 2.0, n)
    target = random_poses(rng, 3).act(source) + 0.1 * rng.normal(size=(n, 3))
    mean = [np.average(p, axis=0, weights=weights) for p in (source, target)]
    oracle, _ = Rotation.align_vectors(target - mean[1], source - mean[0], weights)
    assert_allclose(align(source, target, weights).pose.rotation, oracle.as_matrix(), atol=1e-9)


@given(generators, dims, AMOUNTS)
def test_weights_count_like_repeated_points(rng: np.random.Generator, dim: int, n: int) -> None:
    source, times = rng.normal(size=(n, dim)), rng.integers(1, 4, n)
    target = random_poses(rng, dim).act(source) + 0.1 * rng.normal(size=(n, dim))
    weighted = align(source, target, times.astype(float))
    repeated = align(np.repeat(source, times, 0), np.repeat(target, times, 0))
    assert_same(weighted.pose, repeated.pose)
    assert_allclose([weighted.rms, weighted.rigidity], [repeated.rms, repeated.rigidity], rtol=1e-9)


@given(generators, dims, AMOUNTS)
def test_the_fit_is_a_rotation_even_onto_a_mirror_image(rng: np.random.Generator, dim: int, n: int) -> None:
    source = rng.normal(size=(n, dim))
    target = source * np.append(np.ones(dim - 1), -1.0)
    rotation = align(source, target).pose.rotation
    assert_allclose(np.linalg.det(rotation), 1.0)
    assert_allclose(rotation @ rotation.T, np.eye(dim), atol=1e-12)


@given(generators, dims)
def test_one_shared_pose_is_enough(rng: np.random.Generator, dim: int) -> None:
    x, seen = random_poses(rng, dim, turn=3.1), random_poses(rng, dim, 1)
    fit = _align_poses(seen, x @ seen)
    assert_same(fit.pose, x)
    assert fit.rigidity > 0.1


@given(generators, dims)
def test_one_shared_point_leaves_the_rotation_free(rng: np.random.Generator, dim: int) -> None:
    point = rng.normal(size=(1, dim))
    fit = align(point, point + 1.0)
    assert fit.rigidity == pytest.approx(0.0, abs=1e-12)
    assert_allclose(fit.pose.act(point), point + 1.0, atol=1e-12)
    assert_allclose(np.linalg.det(fit.pose.rotation), 1.0)


@given(generators)
def test_points_on_a_line_hold_a_plane_but_not_space(rng: np.random.Generator) -> None:
    for dim, firm in ((2, True), (3, False)):
        along = rng.normal(scale=2.0, size=5)
        line = along[:, None] * np.eye(dim)[0]
        x = random_poses(rng, dim)
        fit = align(line, x.act(line))
        assert_allclose(fit.pose.act(line), x.act(line), atol=1e-9)
        assert (fit.rigidity > 1e-9) == firm
        if not firm:  # a shared pose holds what the line leaves free
            seen = random_poses(rng, dim, 1)
            assert_same(_align_poses(seen, x @ seen, line, x.act(line)).pose, x)


@given(generators, dims)
def test_rotations_alone_turn_the_fit_where_points_say_nothing(rng: np.random.Generator, dim: int) -> None:
    x, turns = random_poses(rng, dim, turn=3.1), random_poses(rng, dim, 4)
    one_place = np.ones((3, dim))
    fit = align(
        one_place,
        x.act(one_place),
        source_rotations=turns.rotation,
        target_rotations=x.rotation @ turns.rotation,
        kappa=1e-3,
    )
    assert_same(fit.pose, x)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_half_turn_is_found(dim: int) -> None:
    group = rotations(dim)
    w = np.zeros(group.DOF)
    w[0] = np.pi
    source = np.random.default_rng(3).normal(size=(6, dim))
    assert_allclose(align(source, source @ group.exp(w).T).pose.rotation, group.exp(w), atol=1e-12)


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(ModelError, match="at least one"):
        align(np.zeros((0, 2)), np.zeros((0, 2)))
    with pytest.raises(ModelError, match="correspond"):
        align(np.zeros((3, 2)), np.zeros((2, 2)))


def _align_poses(source: Pose, target: Pose, points: Array | None = None, onto: Array | None = None):
    places = [source.translation, target.translation]
    if points is not None and onto is not None:
        places = [np.concatenate([places[0], points]), np.concatenate([places[1], onto])]
    return align(*places, source_rotations=source.rotation, target_rotations=target.rotation)


@given(generators, dims, AMOUNTS)
def test_rotations_weighed_one_by_one(rng: np.random.Generator, dim: int, n: int) -> None:
    """No small motion lowers sum w |p - X q|^2 + sum v |P - R Q|^2."""
    x = random_poses(rng, dim)
    source, weights, each = rng.normal(scale=3.0, size=(n, dim)), rng.uniform(0.1, 2.0, n), rng.uniform(0.1, 9.0, 3)
    target = x.act(source) + 0.3 * rng.normal(size=(n, dim))
    source_poses = random_poses(rng, dim, 3)
    target_poses = (x @ source_poses).retract(0.2 * rng.normal(size=(3, x.dof)))

    def cost(pose: Pose) -> float:
        turns = np.sum((target_poses.rotation - pose.rotation @ source_poses.rotation) ** 2, (-2, -1))
        return float(weights @ np.sum((target - pose.act(source)) ** 2, -1) + each @ turns)

    best = align(
        source,
        target,
        weights,
        source_rotations=source_poses.rotation,
        target_rotations=target_poses.rotation,
        rotation_weights=each,
    ).pose
    for step in (1e-3, 1e-1, 1.0):
        for d in np.concatenate([np.eye(x.dof), -np.eye(x.dof)]):
            assert cost(best) <= cost(best.retract(step * d)) + 1e-9


@given(generators, st.integers(3, 6), st.integers(1, 6))
def test_of_points_that_are_known_in_part_that_part_counts(rng: np.random.Generator, whole: int, flat: int) -> None:
    """An exact motion is recovered from near it, whatever stands where nothing is known."""
    x, source = random_poses(rng, 3, turn=3.1), rng.normal(scale=3.0, size=(whole + flat, 3))
    known = np.ones(source.shape, bool)
    known[whole:, 2] = False
    target = np.where(known, x.act(source), 1e3)
    found = register(Told.of_points(source, target, known), x.retract(0.1 * rng.normal(size=6)))
    assert_same(found.pose, x, 1e-8)


@given(generators)
def test_what_known_numbers_leave_open_stays(rng: np.random.Generator) -> None:
    """One point: it is put where it is known to be, and nothing is turned or lifted beyond need."""
    source, target = rng.normal(size=(1, 3)), np.array([[1.0, 2.0, 1e3]])
    found = register(Told.of_points(source, target, np.array([[True, True, False]])), Pose.identity(3)).pose
    assert_allclose(found.act(source)[0, :2], [1.0, 2.0], atol=1e-9)
    assert np.linalg.norm(found.minus(Pose.identity(3))) < 3.0 + np.linalg.norm(source)


def test_two_places_far_away_leave_the_turn_about_their_line() -> None:
    """In coordinates of a map of the country, from any start: both are put where they are, and nothing fails."""
    places = np.array([[0.1, 0.12, -0.08]] * 3 + [[43.2, -59.9, 59.8]])
    goals = np.array([[529997.76125, 5399997.25739, 202.37533]] * 3 + [[529997.85411, 5399997.27705, 202.91311]])
    known = np.ones(places.shape, bool)
    for turn in turns_apart(3):
        found = register(Told.of_points(places, goals, known), Pose(turn, goals[0] - turn @ places[0]))
        assert np.isfinite(found.pose.translation).all() and found.rank == 5
        assert_allclose(found.pose.act(places).mean(0), goals.mean(0), atol=1e-3)
