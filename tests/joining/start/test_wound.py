"""Starts for ways whose heading may be lost by a turn, and the choice that the team makes among them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies import dims, generators, random_poses
from teamslam.geometry import Array, compose_along
from teamslam.joining import build, build_alternatives, exact_join, full, split
from teamslam.joining.start.wound import SPACING, wound
from teamslam.model import Dataset, Values, pose_key, pose_kind
from teamslam.sim.paper import PaperOptions, simulate_paper
from teamslam.solver import Solution, System, optimise

AMOUNTS = st.integers(2, 15)


def way_of(rng: np.random.Generator, dim: int, n: int) -> Values:
    return Values.of({pose_kind(dim): (pose_key(1, np.arange(n)), compose_along(random_poses(rng, dim, n - 1)))})


def from_truth(dataset: Dataset, base: int) -> Solution:
    assert dataset.truth is not None
    truth = dataset.truth.only(dataset.layout.keys)
    truth = truth.transform(truth.pose(base).inverse())
    return optimise(System(truth.layout, tables=dataset.tables, fixed=np.array([base])), truth)


@given(generators, dims, AMOUNTS)
def test_a_way_whose_heading_is_known_has_one_start(rng: np.random.Generator, dim: int, n: int) -> None:
    way = way_of(rng, dim, n)
    assert wound(way, np.full(n - 1, 0.3**2 / (n - 1))) == [way]


@given(generators, AMOUNTS)
def test_bends_keep_the_steps_and_turn_the_heading_evenly(rng: np.random.Generator, n: int) -> None:
    way, variances = way_of(rng, 2, n), rng.uniform(0.5, 1.5, n - 1)
    variances *= 1.3**2 / variances.sum()  # 3 sigma = 3.9 rad: one bend each way
    starts = wound(way, variances)
    assert len(starts) == 3 and starts[0] is way
    ends = []
    for start in starts:
        poses, straight = start.poses_of(way.layout.keys, 2), way.poses_of(way.layout.keys, 2)
        before, after = straight[:-1].between(straight[1:]), poses[:-1].between(poses[1:])
        np.testing.assert_allclose(after.translation, before.translation, atol=1e-9)
        np.testing.assert_allclose(poses[0].minus(straight[0]), 0.0, atol=1e-12)
        turned: Array = np.cumsum(after.minus(before)[:, 2])
        ends.append(turned[-1])
        np.testing.assert_allclose(turned, turned[-1] * np.cumsum(variances) / variances.sum(), atol=1e-9)
    np.testing.assert_allclose(sorted(ends), [-SPACING, 0.0, SPACING], atol=1e-9)


@pytest.mark.parametrize("seed", [1, 3, 13, 51, 650, 1843])
def test_a_noisy_team_reaches_the_cost_of_a_start_from_the_truth(seed: int) -> None:
    """The paper's highest noise, where dead reckoning alone ends in local minima in the first four runs: in 1 and 13
    one submap winds the wrong way round, in 3 and 51 the wrong one even fits its own measurements better. In 650 and
    1843 no optimum of the submaps leads to the team's; the ways they started from do."""
    dataset = simulate_paper(PaperOptions("minimum", 12, 0.3, 0.4), seed)
    found = full(dataset).map
    assert found.cost <= from_truth(dataset, found.base).cost * (1.0 + 1e-6)


@pytest.mark.parametrize("seed", [3, 650])
def test_exact_joining_makes_the_same_choice(seed: int) -> None:
    dataset = simulate_paper(PaperOptions("minimum", 12, 0.3, 0.4), seed)
    assert exact_join(split(dataset)).map.cost == pytest.approx(full(dataset).map.cost, rel=1e-9)


def test_alternatives_are_distinct_optima_lowest_first() -> None:
    dataset = simulate_paper(PaperOptions("minimum", 12, 0.3, 0.4), 3)
    for piece in split(dataset):
        found = build_alternatives(piece)
        costs = [submap.cost for submap in found]
        assert costs == sorted(costs) and found[0].cost == build(piece).cost
        assert len({submap.id for submap in found}) == 1
        for submap in found[1:]:
            assert np.abs(submap.values.minus(found[0].values)).max() > 0.1
