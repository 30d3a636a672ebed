"""Laws of tables and of whitening, and what a table refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from sightings import MARKS, OBSERVERS, OTHERS, SETTINGS, every_table, table_of, world
from strategies import batches, generators, random_poses
from teamslam.errors import ModelError
from teamslam.geometry import Array, Pose
from teamslam.model import MODELS, Kind, Loss, Model, Table, Values, pose_key, whitening
from worlds import team

KEYS = np.stack([OBSERVERS, MARKS], -1)


def point_table(**changes: object) -> Table:
    """Four sightings of points in the plane, with what a test changes."""
    whole = {
        "robot": 1,
        "source": "landmarks",
        "model": "point",
        "dim": 2,
        "keys": KEYS,
        "values": np.zeros((4, 2)),
        "whitening": np.eye(2)[None],
        "ids": np.arange(4),
    }
    return Table(**(whole | changes))


def covariances(rng: np.random.Generator, size: int, *batch: int) -> Array:
    """Random covariances, well conditioned."""
    root = np.eye(size) + 0.3 * rng.normal(size=(*batch, size, size))
    return np.asarray(root @ np.swapaxes(root, -1, -2))


# --- whitening ------------------------------------------------------------------------------------------------------


@given(generators, st.integers(1, 6), batches)
def test_whitening_whitens(rng: np.random.Generator, size: int, batch: tuple[int, ...]) -> None:
    """W C W' = 1, so C^-1 = W'W."""
    c = covariances(rng, size, *batch)
    w = whitening(c)
    assert w.shape == c.shape
    assert_allclose(w @ c @ np.swapaxes(w, -1, -2), np.broadcast_to(np.eye(size), c.shape), atol=1e-11)


@given(generators, st.lists(st.integers(-9, 9), min_size=1, max_size=6))
def test_whitening_does_not_mind_units(rng: np.random.Generator, powers: list[int]) -> None:
    """Kilometres beside microradians: W(D C D) = W(C) D^-1 for any diagonal D."""
    scale, c = 10.0 ** np.array(powers), covariances(rng, len(powers))
    rescaled = whitening(scale[:, None] * c * scale)
    assert_allclose(rescaled * scale, whitening(c), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "covariance, reason",
    [
        (np.array([[1.0, np.nan], [np.nan, 1.0]]), "not finite"),
        (np.array([[np.inf, 0.0], [0.0, 1.0]]), "not finite"),
        (np.array([[1.0, 0.5], [0.4, 1.0]]), "not symmetric"),
        (np.array([[1e-6, 1e-8], [-1e-8, 1e-6]]), "not symmetric"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), "not positive definite"),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), "not positive definite"),
        (np.diag([1.0, 0.0]), "not positive definite"),
        (np.diag([1.0, -1.0]), "not positive definite"),
        (np.zeros((2, 2)), "not positive definite"),
    ],
)
def test_what_is_no_covariance_is_refused(covariance: Array, reason: str) -> None:
    with pytest.raises(ModelError, match=f"covariance 0 .*{reason}"):
        whitening(covariance)
    with pytest.raises(ModelError, match=f"covariance 2 .*{reason}"):
        whitening(np.stack([np.eye(2), np.eye(2), covariance]))


# --- what a table refuses -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes, reason",
    [
        ({"model": "smell"}, "unknown model 'smell'; known are relative_pose, point"),
        ({"dim": 4}, "found dimension 4"),
        ({"sensor": Pose.identity(3)}, "mounted in space cannot measure in the plane"),
        ({"keys": KEYS[:, :1]}, r"keys should have shape \(4, 2\), found \(4, 1\)"),
        ({"values": np.zeros((4, 3))}, r"values should have shape \(4, 2\), found \(4, 3\)"),
        ({"values": np.zeros((3, 2))}, r"values should have shape \(4, 2\), found \(3, 2\)"),
        ({"whitening": np.eye(2)}, r"whitening should have shape \(4, 2, 2\) or \(1, 2, 2\)"),
        ({"whitening": np.ones((4, 3, 3))}, r"whitening should have shape"),
        ({"ids": np.arange(3)}, r"ids should have shape \(4,\), found \(3,\)"),
        ({"values": np.full((4, 2), np.nan)}, "values hold a number that is not finite"),
        ({"whitening": np.full((1, 2, 2), np.inf)}, "whitening hold a number that is not finite"),
    ],
)
def test_a_table_that_does_not_fit_its_model_is_refused(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        point_table(**changes)


def test_a_table_says_what_it_needs_that_is_not_there() -> None:
    with pytest.raises(ModelError, match="not among the 0"):
        point_table().residual(Values.of({}))


def test_a_relative_pose_needs_a_pose() -> None:
    values = world(np.random.default_rng(0), SETTINGS[0])
    keys, z = np.stack([OBSERVERS, MARKS], -1), np.zeros((4, 6))
    with pytest.raises(ModelError, match="is a point where a pose is needed"):
        Table(1, "tags", "relative_pose", 2, keys, z, np.eye(3)[None], np.arange(4)).residual(values)


# --- parts and ends -------------------------------------------------------------------------------------------------


@given(generators, st.lists(st.booleans(), min_size=4, max_size=4))
def test_a_part_of_a_table_sees_what_the_whole_sees(rng: np.random.Generator, chosen: list[bool]) -> None:
    values, mask = world(rng, SETTINGS[1]), np.array(chosen)
    shaken = values.retract(0.3 * rng.normal(size=values.layout.dof))
    for table in every_table(rng, values, SETTINGS[1]):
        for whole in (table, replace(table, whitening=table.whitening[:1])):
            for index in (mask, np.flatnonzero(mask)):
                part = whole.select(index)
                assert_allclose(part.whitened(shaken), whole.whitened(shaken)[mask], atol=1e-12)
                assert_array_equal(part.ids, whole.ids[mask])
                assert part.dof == mask.sum() * whole.row.residual_rows(whole.dim)


def test_a_mask_with_all_rows_chooses_the_table_itself() -> None:
    table = point_table()
    assert table.select(np.ones(4, bool)) is table
    assert len(table.select(np.zeros(4, bool))) == 0
    with pytest.raises(IndexError):
        table.select(np.ones(3, bool))


def test_a_table_of_one_row_keeps_its_noise_when_rows_are_chosen() -> None:
    one = point_table().select(np.array([2]))
    assert len(one.select(np.array([True]))) == 1
    assert len(one.select(np.array([False]))) == 0
    assert len(one.select(np.array([0])).select(np.zeros(0, int))) == 0


def test_an_empty_table_is_a_table() -> None:
    values = world(np.random.default_rng(0), SETTINGS[0])
    for table in every_table(np.random.default_rng(1), values, SETTINGS[0]):
        nothing = table.select(np.zeros(0, int))
        assert len(nothing) == nothing.dof == 0
        assert nothing.whitened(values).shape == (0, table.row.residual_rows(2))
        assert not nothing.observes_robots


@given(generators)
def test_a_team_of_planar_and_spatial_robots_sees_in_space(rng: np.random.Generator) -> None:
    """A planar robot sees a spatial one: the same as if it were a spatial robot that only yaws."""
    rover, drone = random_poses(rng, 2, 4), random_poses(rng, 3, 4)
    mixed = Values.of({Kind.POSE2: (OBSERVERS, rover), Kind.POSE3: (OTHERS, drone)})
    lifted = Values.of({Kind.POSE3: (np.concatenate([OBSERVERS, OTHERS]), _joined(rover.lift(3), drone))})
    keys = np.stack([OBSERVERS, OTHERS], -1)
    for model in ("relative_pose", "point", "range", "bearing", "range_bearing"):
        table = table_of(rng, model, 3, keys, mixed)
        assert_allclose(table.predict(mixed), table.predict(lifted), atol=1e-12)


@given(generators)
def test_predicting_from_given_ends_is_predicting_from_values(rng: np.random.Generator) -> None:
    values = world(rng, SETTINGS[1])
    for table in every_table(rng, values, SETTINGS[1]):
        observer, target = table.ends(values)
        assert (observer is None) == table.row.unary
        assert_array_equal(table.predict_from(observer, target), table.predict(values))


def test_a_table_knows_whether_it_sees_other_robots() -> None:
    assert not point_table().observes_robots
    assert point_table(keys=np.stack([OBSERVERS, OTHERS], -1)).observes_robots
    own = np.stack([OBSERVERS, pose_key(1, np.arange(4) + 1)], -1)
    assert not point_table(keys=own).observes_robots


def test_a_loss_belongs_to_a_table_and_leaves_the_old_one_alone() -> None:
    table = point_table()
    robust = table.with_loss(Loss("huber", 2.0))
    assert robust.loss == Loss("huber", 2.0) and table.loss == Loss()
    assert robust.keys is table.keys


def _joined(a: Pose, b: Pose) -> Pose:
    return Pose(np.concatenate([a.rotation, b.rotation]), np.concatenate([a.translation, b.translation]))


def test_a_sensor_of_ones_own_that_predicts_another_shape_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    row = Model(lambda observer, target, dim: np.zeros(5), lambda z, h, dim: z - h, size=(1, 1), rows=(1, 1))
    monkeypatch.setitem(MODELS, "loud", row)
    seen = next(t for t in team("2d", poses=4).tables if t.source == "landmarks")
    one = np.broadcast_to(np.eye(1), (len(seen), 1, 1))
    loud = replace(seen, model="loud", values=seen.values[:, :1], whitening=one)
    with pytest.raises(ModelError, match=r"loud\): what is predicted should have shape \(\d+, 1\).*found \(5,\)"):
        loud.predict_from(Pose.identity(2, (len(seen),)), np.zeros((len(seen), 2)))
