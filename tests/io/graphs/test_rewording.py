"""Measurements in other words: near the measurement they cost the same, and what is exact stays exact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from logs import measured
from strategies import dims, generators, random_poses
from teamslam.io.graphs.rewording import as_points, as_range_bearing, as_relative_pose, at_body, reworded
from teamslam.model import (
    Dataset,
    Table,
    Values,
    landmark_key,
    point_kind,
    pose_key,
    pose_kind,
)

A, B, MARK = int(pose_key(1, 0)), int(pose_key(1, 1)), int(landmark_key(7))


def table(rng: np.random.Generator, model: str, dim: int, target: int = MARK, *, sensor: bool = False) -> Table:
    values = measured(rng, model, dim, 1)
    rows = dim if model != "relative_pose" else 3 * dim - 3
    whitening = rng.normal(size=(1, rows, rows)) + 3 * np.eye(rows)
    eye = random_poses(rng, dim) if sensor else None
    return Table(1, "landmarks", model, dim, np.array([[A, target]]), values, whitening, np.array([0]), eye)


def values_near(rng: np.random.Generator, seen: Table, size: float) -> Values:
    """An estimate in which the target is nearly where it was seen."""
    dim = seen.dim
    observer = random_poses(rng, dim, 1)
    eye = observer if seen.sensor is None else observer @ seen.sensor
    point = eye.act(as_points(seen).values if seen.model == "range_bearing" else seen.values[:, :dim])
    marks = (np.array([MARK]), point + size * rng.normal(size=(1, dim)))
    return Values.of({pose_kind(dim): (np.array([A]), observer), point_kind(dim): marks})


def cost(seen: Table, values: Values) -> float:
    return float(np.sum(seen.whitened(values) ** 2))


@given(dims, generators, st.booleans())
def test_ranges_with_bearings_cost_the_same_as_points(dim: int, rng: np.random.Generator, sensor: bool) -> None:
    seen = table(rng, "range_bearing", dim, sensor=sensor)
    for _ in range(3):
        values = values_near(rng, seen, 1e-6)
        assert cost(as_points(seen), values) == pytest.approx(cost(seen, values), rel=1e-3)


@given(dims, generators)
def test_there_and_back(dim: int, rng: np.random.Generator) -> None:
    seen = table(rng, "range_bearing", dim)
    back = as_range_bearing(as_points(seen))
    assert np.allclose(np.cos(back.values - seen.values), 1.0) and np.allclose(back.whitening, seen.whitening)
    seen = table(rng, "point", dim)
    back = as_points(as_range_bearing(seen))
    assert np.allclose(back.values, seen.values) and np.allclose(back.whitening, seen.whitening)


@given(dims, generators)
def test_what_a_sensor_saw_costs_the_same_seen_from_the_body(dim: int, rng: np.random.Generator) -> None:
    """Exactly, wherever the target is."""
    seen = table(rng, "point", dim, sensor=True)
    values = values_near(rng, seen, 10.0)
    assert cost(at_body(seen), values) == pytest.approx(cost(seen, values), rel=1e-9)
    seen = table(rng, "relative_pose", dim, B, sensor=True)
    values = Values.of({pose_kind(dim): (np.array([A, B]), random_poses(rng, dim, 2))})
    assert cost(at_body(seen), values) == pytest.approx(cost(seen, values), rel=1e-9)


@given(dims, generators)
def test_where_a_robot_is_costs_the_same_as_a_pose_whose_turn_is_open(dim: int, rng: np.random.Generator) -> None:
    """Exactly, wherever the robot is and however it is turned."""
    seen = table(rng, "point", dim, B)
    values = Values.of({pose_kind(dim): (np.array([A, B]), random_poses(rng, dim, 2))})
    other = as_relative_pose(seen)
    assert cost(other, values) == pytest.approx(cost(seen, values), rel=1e-12) and other.dof == seen.dof == dim


def words(*known: tuple[str, bool]) -> object:
    return lambda seen, ends: (seen.model, seen.sensor is not None) in known


@pytest.mark.parametrize(
    ("model", "sensor", "known", "becomes"),
    [
        ("point", False, ("point", False), "point"),
        ("point", True, ("point", False), "point"),
        ("range_bearing", False, ("point", False), "point"),
        ("range_bearing", True, ("point", True), "point"),
        ("range_bearing", True, ("point", False), "point"),
        ("point", True, ("range_bearing", False), "range_bearing"),
        ("range", False, ("point", False), None),
        ("range", True, ("range", False), None),
        ("bearing", False, ("point", False), None),
    ],
)
def test_the_plainest_words_that_a_format_has(model: str, sensor: bool, known: tuple[str, bool], becomes: str) -> None:
    rng = np.random.default_rng(0)
    seen = table(rng, model, 2, sensor=sensor) if model not in ("range", "bearing") else _one_row(rng, model, sensor)
    parts, without, said = reworded(Dataset({1: 2}, (seen,)), words(known))  # type: ignore[arg-type]
    assert [part.model for part, _ in parts] == ([becomes] if becomes else [])
    assert len(without) == (becomes is None)
    changed = becomes is not None and ((model, sensor) != known)
    assert [drop.count for drop in said] == ([1] if changed else [])


def _one_row(rng: np.random.Generator, model: str, sensor: bool) -> Table:
    eye = random_poses(rng, 2) if sensor else None
    return Table(1, "landmarks", model, 2, np.array([[A, MARK]]), np.ones((1, 1)), np.eye(1)[None], np.array([0]), eye)


def test_a_range_of_zero_has_no_bearing() -> None:
    rng = np.random.default_rng(0)
    seen = table(rng, "range_bearing", 2)
    at_zero = Table(1, "landmarks", "range_bearing", 2, seen.keys, np.zeros((1, 2)), seen.whitening, seen.ids)
    _, without, _ = reworded(Dataset({1: 2}, (at_zero,)), words(("point", False)))  # type: ignore[arg-type]
    assert len(without) == 1
