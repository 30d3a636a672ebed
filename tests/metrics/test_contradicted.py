"""Landmarks that the truth has elsewhere are named, and no others: not where errors are large, or of many sizes."""

from dataclasses import replace

import numpy as np
import pytest

from metrics_maps import TEAMS, frame_dim, map_of, small, some_frame
from teamslam.metrics import score, told_of
from teamslam.model import Kind, Values, index_of, is_landmark
from teamslam.solver import Covariances


def drawn(team, seed, uneven=1.0):
    """A map with errors as its information says; `uneven`: how much better some are known."""
    rng = np.random.default_rng(seed)
    dataset = small(team, seed)
    n = map_of(dataset).dof
    sigma = 0.02 * np.exp(rng.uniform(0.0, np.log(uneven), n)) if uneven > 1.0 else np.full(n, 0.02)
    map = map_of(dataset, sigma * rng.normal(size=n), np.diag(sigma**-2.0))
    return dataset, map


def moved(truth, keys, by, rng):
    """A truth that has some landmarks elsewhere."""
    state = truth.state.copy()
    for key in keys:
        place = truth.layout.index(np.array([key]))[0]
        dim = Kind(int(truth.layout.kinds[place])).dim
        direction = rng.normal(size=dim)
        start = truth.layout.state_start[place]
        state[start : start + dim] += by * direction / np.linalg.norm(direction)
    return Values(truth.layout, state)


def named(map, truth):
    return {found.landmark for found in score(map, truth, covariances=Covariances.of_map(map)).contradicted}


@pytest.mark.parametrize("team", TEAMS)
@pytest.mark.parametrize("uneven", [1.0, 30.0])
def test_those_that_were_moved_are_named_in_any_frame_and_no_others(team, uneven):
    rng = np.random.default_rng(7)
    dataset, map = drawn(team, 3, uneven)
    known = np.array([k for k in map.keys if is_landmark(k) and dataset.truth.layout.contains(k)])
    lost = rng.choice(known, 2, replace=False)
    truth = moved(dataset.truth, lost, 5.0, rng).transform(some_frame(frame_dim(dataset), rng))
    assert named(map, truth) == {map.names.landmark(int(index_of(k))) for k in lost}


@pytest.mark.parametrize("team", TEAMS)
def test_of_landmarks_with_heights_above_a_plane_it_is_said_how_they_are_looked_at(team):
    """Heights may be off by more than the sentence says of the others."""
    dataset, map = drawn(team, 3)
    known = np.array([k for k in map.keys if is_landmark(k) and dataset.truth.layout.contains(k)])
    truth = moved(dataset.truth, known[:2], 5.0, np.random.default_rng(7))
    layout, planar = dataset.truth.layout, frame_dim(dataset) == 2
    heights = all(Kind(int(layout.kinds[layout.index(np.array([k]))[0]])).dim == 3 for k in known)
    found = score(map, truth, covariances=Covariances.of_map(map)).contradicted
    assert found and ("seen from above" in told_of(found)) == (planar and heights)


def test_honest_maps_name_nobody():
    alarms = sum(bool(named(map, dataset.truth)) for dataset, map in (drawn("2d", seed, 30.0) for seed in range(40)))
    assert alarms <= 2


def test_where_map_and_truth_err_alike_by_more_than_the_map_says_nobody_is_named():
    """Systematic errors of a survey, tenfold what the map says of itself, are a spread of all, and no mistakes."""
    dataset, map = drawn("2d", 5)
    sure = replace(map, information=100.0 * map.information)
    assert not named(sure, dataset.truth)


def test_few_landmarks_accuse_nobody():
    dataset = small("2d", 1, landmarks=4)
    map = map_of(dataset)
    marks = [k for k in map.keys if is_landmark(k)]
    assert not named(map, moved(dataset.truth, marks[:1], 5.0, np.random.default_rng(0)))
