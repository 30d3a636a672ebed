"""Laws of every row of MODELS, and each formula against one written by hand for a single sighting."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sightings import MARKS, OBSERVERS, OTHERS, SETTINGS, Setting, every_table, table_of, world
from strategies import generators, random_poses, unit_vectors
from teamslam.errors import ModelError
from teamslam.geometry import Array, Pose, direction_basis
from teamslam.model import MODELS, Kind, Model, Table, Values, pack

settings_drawn = st.sampled_from(SETTINGS)


@given(generators, settings_drawn)
def test_what_is_predicted_leaves_no_residual(rng: np.random.Generator, setting: Setting) -> None:
    values = world(rng, setting)
    seen = set()
    for table in every_table(rng, values, setting):
        row, dim = MODELS[table.model], table.dim
        assert table.predict(values).shape == (len(table), row.z_size(dim))
        assert table.residual(values).shape == (len(table), row.residual_rows(dim))
        assert len(set(row.part_names(dim))) == row.residual_rows(dim)
        assert_allclose(table.residual(values), 0.0, atol=1e-12)
        seen.add(table.model)
    assert seen == {name for name, row in MODELS.items() if row.z_size(setting.dim)}


def test_parts_that_nobody_named_are_counted() -> None:
    row = MODELS["range_bearing"]
    assert Model(row.predict, row.minus, row.size, row.rows).part_names(3) == ("1", "2", "3")


@given(generators, settings_drawn)
def test_robots_cannot_tell_where_the_world_is(rng: np.random.Generator, setting: Setting) -> None:
    """Any rigid motion of everything leaves what robots see of each other and of landmarks unchanged."""
    values, moved_by = world(rng, setting), random_poses(rng, setting.robot.dim, spread=20.0, turn=3.1)
    shaken = values.retract(0.3 * rng.normal(size=values.layout.dof))
    for table in every_table(rng, values, setting):
        if not table.row.unary:
            assert_allclose(table.residual(shaken.transform(moved_by)), table.residual(shaken), atol=1e-9)


@given(generators, settings_drawn)
def test_a_residual_is_the_noise_of_its_measurement(rng: np.random.Generator, setting: Setting) -> None:
    """z = h (+) n leaves e = n: exactly for poses, points, ranges and angles; to second order for directions."""
    values = world(rng, setting)
    for table in every_table(rng, values, setting):
        noise = 1e-6 * rng.normal(size=(len(table), table.row.residual_rows(table.dim)))
        noisy = _with_values(table, _disturbed(table, noise))
        assert_allclose(noisy.residual(values), noise, atol=1e-9)


@given(generators, settings_drawn)
def test_whitening_multiplies_the_residual(rng: np.random.Generator, setting: Setting) -> None:
    values = world(rng, setting)
    shaken = values.retract(0.3 * rng.normal(size=values.layout.dof))
    for table in every_table(rng, values, setting):
        one_for_all = Table(
            1, "s", table.model, table.dim, table.keys, table.values, table.whitening[:1], table.ids, table.sensor
        )
        for w, residual, each, shared in zip(
            table.whitening, table.residual(shaken), table.whitened(shaken), one_for_all.whitened(shaken), strict=True
        ):
            assert_allclose(each, w @ residual, atol=1e-12)
            assert_allclose(shared, table.whitening[0] @ residual, atol=1e-12)


@given(generators, settings_drawn)
def test_a_sensor_sees_from_where_it_sits(rng: np.random.Generator, setting: Setting) -> None:
    """Seeing with a sensor at pose S in the body is seeing from a robot that stands at body @ S; measuring a sensor at
    S in the world is measuring a robot that stands at body @ S."""
    values = world(rng, setting)
    if setting.robot is Kind.POSE2 and setting.dim == 3:
        return  # a tilted sensor on a planar robot stands at a pose that no planar robot has
    for table in every_table(rng, values, setting):
        if table.sensor is None:
            continue
        carriers = OTHERS if table.row.unary else OBSERVERS  # what was measured in the world, or who measured
        stand = values.poses_of(carriers, setting.robot.dim) @ table.sensor
        there = values.update(Values.of({setting.robot: (carriers, stand)}))
        plain = Table(1, "s", table.model, table.dim, table.keys, table.values, table.whitening, table.ids)
        assert_allclose(plain.predict(there), table.predict(values), atol=1e-11)


# --- formulas by hand -----------------------------------------------------------------------------------------------


def test_a_point_seen_by_a_planar_robot_is_the_papers_equation_3() -> None:
    """R'(F - T) - o with the sensor's offset o = (0, 0, h): R transposed, against the printed sign of eq. (16)."""
    x, y, theta, height = 1.0, -2.0, 0.6, 1.0
    mark = np.array([4.0, 1.5, 2.0])
    values = Values.of(
        {
            Kind.POSE2: (OBSERVERS[:1], Pose.from_xytheta(np.array([[x, y, theta]]))),
            Kind.POINT3: (MARKS[:1], mark[None]),
        }
    )
    eye = Pose(np.eye(3), np.array([0.0, 0.0, height]))
    table = table_of(np.random.default_rng(0), "point", 3, np.stack([OBSERVERS[:1], MARKS[:1]], -1), values, eye)
    dx, dy = mark[0] - x, mark[1] - y
    c, s = np.cos(theta), np.sin(theta)
    assert_allclose(table.values, [[c * dx + s * dy, -s * dx + c * dy, mark[2] - height]])


@given(generators)
def test_planar_models_by_hand(rng: np.random.Generator) -> None:
    values = world(rng, SETTINGS[0])
    tables = {(t.model, int(t.keys[0, -1])): t for t in every_table(rng, values, SETTINGS[0], sensor=False)}
    for n in range(4):
        x, y, theta = values.pose(OBSERVERS[n]).xytheta()
        for target, place in (
            (OTHERS, values.pose(OTHERS[n]).translation),
            (MARKS, values.positions(MARKS[n], 2)),
        ):
            dx, dy = place[0] - x, place[1] - y
            point = [np.cos(theta) * dx + np.sin(theta) * dy, -np.sin(theta) * dx + np.cos(theta) * dy]
            bearing = (np.arctan2(dy, dx) - theta + np.pi) % (2 * np.pi) - np.pi
            expected = {
                "point": point,
                "range": [np.hypot(dx, dy)],
                "bearing": [bearing],
                "range_bearing": [np.hypot(dx, dy), bearing],
                "position": place,
            }
            for model, z in expected.items():
                assert_allclose(tables[model, int(target[0])].values[n], z, atol=1e-12)


@given(generators)
def test_spatial_models_by_hand(rng: np.random.Generator) -> None:
    values = world(rng, SETTINGS[2])
    tables = {(t.model, int(t.keys[0, -1])): t for t in every_table(rng, values, SETTINGS[2], sensor=False)}
    for n in range(4):
        observer = values.pose(OBSERVERS[n])
        turn = Rotation.from_matrix(observer.rotation)
        place = values.positions(MARKS[n], 3)
        point = turn.inv().apply(place - observer.translation)
        distance = np.sqrt((point**2).sum())
        expected = {
            "point": point,
            "range": [distance],
            "bearing": point / distance,
            "range_bearing": [distance, *(point / distance)],
            "position": place,
        }
        for model, z in expected.items():
            assert_allclose(tables[model, int(MARKS[0])].values[n], z, atol=1e-12)


@given(generators)
def test_the_residual_of_a_relative_pose_by_hand(rng: np.random.Generator) -> None:
    """e = [zT - R1'(T2 - T1) ; Log((R1'R2)' zR)], eqs. (4) and (5) with the rotation as a vector of the same sign."""
    values = world(rng, SETTINGS[2])
    z = random_poses(rng, 3, 4, turn=3.0)
    keys = np.stack([OBSERVERS, OTHERS], -1)
    table = Table(1, "robots", "relative_pose", 3, keys, pack(z), np.eye(6)[None], np.arange(4))
    for n, e in enumerate(table.residual(values)):
        one, two = values.pose(OBSERVERS[n]), values.pose(OTHERS[n])
        r1, r2, rz = (Rotation.from_matrix(p.rotation) for p in (one, two, z[n]))
        assert_allclose(e[:3], z.translation[n] - r1.inv().apply(two.translation - one.translation), atol=1e-12)
        assert_allclose(e[3:], ((r1.inv() * r2).inv() * rz).as_rotvec(), atol=1e-12)


@pytest.mark.parametrize("beyond", [1e-3, 0.5, 3.0])
def test_bearings_wrap(beyond: float) -> None:
    """A bearing measured on the other side of the jump at pi is near, not a turn away."""
    minus = MODELS["bearing"].minus
    assert_allclose(minus(np.array([[-np.pi + beyond]]), np.array([[np.pi - 0.01]]), 2), beyond + 0.01)
    assert_allclose(minus(np.array([[20 * np.pi + beyond]]), np.array([[0.0]]), 2), beyond, atol=1e-12)
    mixed = MODELS["range_bearing"].minus(np.array([[5.0, -np.pi + beyond]]), np.array([[4.0, np.pi]]), 2)
    assert_allclose(mixed, [[1.0, beyond]])


@given(generators)
def test_a_difference_of_directions_is_as_long_as_their_angle(rng: np.random.Generator) -> None:
    z, h = unit_vectors(rng, 3, (6,)), unit_vectors(rng, 3, (6,))
    length = np.linalg.norm(MODELS["bearing"].minus(z, h, 3), axis=-1)
    assert_allclose(length, np.arccos(np.sum(z * h, -1)), atol=1e-7)


@given(generators)
def test_the_basis_of_a_direction_points_east_and_up(rng: np.random.Generator) -> None:
    """[east, up, direction] is orthonormal; east is level, up does not go down; the poles are no exception."""
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    directions = np.concatenate([unit_vectors(rng, 3, (6,)), poles, np.eye(3)])
    basis = direction_basis(directions)
    frame = np.concatenate([basis, directions[..., None]], -1)
    assert_allclose(np.swapaxes(frame, -1, -2) @ frame, np.broadcast_to(np.eye(3), frame.shape), atol=1e-12)
    assert_allclose(basis[:, 2, 0], 0.0)
    assert (basis[:, 2, 1] >= -1e-12).all()


def test_a_direction_needs_a_target_of_the_plane_or_space() -> None:
    """A spatial target cannot be measured as a planar pose: that would lose its height without a word."""
    values = world(np.random.default_rng(0), SETTINGS[2])
    with pytest.raises(ModelError, match="without loss"):
        table_of(np.random.default_rng(0), "pose", 2, OTHERS[:, None], values)


@given(generators)
def test_every_model_changes_smoothly_with_the_state(rng: np.random.Generator) -> None:
    """Central differences at two step sizes agree: no kink, no jump near a generic world."""
    for setting in SETTINGS:
        values = world(rng, setting)
        direction = rng.normal(size=values.layout.dof)
        for table in every_table(rng, values, setting):
            slopes = [
                (table.residual(values.retract(h * direction)) - table.residual(values.retract(-h * direction))) / 2 / h
                for h in (1e-5, 1e-6)
            ]
            assert_allclose(slopes[0], slopes[1], atol=1e-4, rtol=1e-4)


# --- noise by hand --------------------------------------------------------------------------------------------------


def _disturbed(table: Table, noise: Array) -> Array:
    """Measurements h (+) n, written out for each kind of measurement."""
    z, d = table.values, table.dim
    if table.row.measures_pose:
        poses = Pose(z[:, d:].reshape(-1, d, d), z[:, :d])
        return pack(poses.retract(noise))
    if table.model == "corners":
        rays = z[:, :12].reshape(-1, 4, 3)
        moved = rays + (direction_basis(rays) @ noise.reshape(-1, 4, 2, 1))[..., 0]
        moved /= np.linalg.norm(moved, axis=-1, keepdims=True)
        return np.concatenate([moved.reshape(-1, 12), z[:, 12:]], -1)
    if d == 3 and table.model in ("bearing", "range_bearing"):
        ranges, direction = z[:, :-3], z[:, -3:]
        moved = direction + (direction_basis(direction) @ noise[:, -2:, None])[..., 0]
        moved /= np.linalg.norm(moved, axis=-1, keepdims=True)
        return np.concatenate([ranges + noise[:, :-2], moved], -1)
    return z + noise


def _with_values(table: Table, values: Array) -> Table:
    return Table(
        table.robot, table.source, table.model, table.dim, table.keys, values, table.whitening, table.ids, table.sensor
    )
