"""Landmarks that lie where a loss forgives what sees them, put where that is seen for less."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.geometry import Array, IntArray
from teamslam.joining import build, full, join, split
from teamslam.joining.start.elsewhere import elsewhere
from teamslam.model import Dataset, Kind, Loss, Values
from worlds import team

BASE = np.zeros(0, np.int64)
FORGIVING = Loss("cauchy", 2.0)


def log_of(model: str, *, sigma: float = 1e-3) -> Dataset:
    made = team("2d", robots=3, poses=12, model=model, sigma=sigma, sigma_odometry=sigma)
    return made.with_tables(t.with_loss(FORGIVING) if t.source == "landmarks" else t for t in made.tables)


def thrown(values: Values, keys: IntArray) -> Values:
    """Some landmarks 20 m away from where they are."""
    places = values.positions(keys, 2) + 20.0
    return values.update(Values.of({Kind.POINT2: (keys, places)}))


@pytest.mark.parametrize("model", ["range", "bearing", "range_bearing", "point"])
def test_a_landmark_that_is_far_off_is_put_back(model: str) -> None:
    log = log_of(model)
    assert log.truth is not None
    moved = elsewhere(thrown(log.truth, log.landmark_keys[:3]), log.tables, BASE)
    assert moved is not None
    off = moved.positions(log.landmark_keys, 2) - log.truth.positions(log.landmark_keys, 2)
    assert np.abs(off).max() < 0.1


@pytest.mark.parametrize("model", ["range", "bearing", "range_bearing", "point"])
def test_where_all_fits_nothing_moves(model: str) -> None:
    log = log_of(model)
    assert log.truth is not None and elsewhere(log.truth, log.tables, BASE) is None


def test_what_is_held_stays() -> None:
    log = log_of("range")
    assert log.truth is not None
    some = log.landmark_keys[:3]
    assert elsewhere(thrown(log.truth, some), log.tables, some) is None


def test_the_optimum_does_not_depend_on_where_a_landmark_was_first() -> None:
    """Full least squares from a join of which landmarks lie mirrored in a line between two who range them: those two
    ranges fit, and a loss forgives the others."""
    log = log_of("range", sigma=1e-5)
    joined = join(build(piece) for piece in split(log))
    (component,) = joined.components
    values = component.map.all_values
    mirrored = [_mirrored(values, log, key) for key in log.landmark_keys]
    off = replace(component.map, values=component.map.values.update(Values.of({
        Kind.POINT2: (log.landmark_keys, np.array(mirrored))
    })))  # fmt: skip
    starts = [replace(joined, components=(replace(component, map=one),)) for one in (component.map, off)]
    here, there = (full(log, initial=start) for start in starts)
    assert there.map.cost == pytest.approx(here.map.cost, rel=1e-6)


def _mirrored(values: Values, log: Dataset, key: int) -> Array:
    """Where a landmark is on the other side of the line from the first to the last pose of one robot that sees it."""
    table = max((t for t in log.tables if t.model == "range"), key=lambda t: np.count_nonzero(t.keys[:, 1] == key))
    seers = values.positions(table.keys[table.keys[:, 1] == key][[0, -1], 0], 2)
    place = values.positions(np.array([key]), 2)[0]
    along = (seers[1] - seers[0]) / np.linalg.norm(seers[1] - seers[0])
    across = np.array([-along[1], along[0]])
    return np.asarray(place - 2.0 * across * ((place - seers[0]) @ across))
