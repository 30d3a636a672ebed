"""Every join knows how far it is from the full least squares, though nobody holds all raw data."""

import numpy as np
import pytest

from teamslam.joining import ORDERS, AtMap, Joined, build, exact_join, full, join, split, with_exactness
from teamslam.model import Dataset, Loss, Submap
from teamslam.solver import Options
from worlds import WORLDS, measure, team

TIGHT = Options(decrement=1e-10, cost_share=1e-18)


def built(log: Dataset) -> list[tuple[Dataset, Submap]]:
    return [(piece, build(piece)) for piece in split(log, poses_per_piece=5)]


def full_cost(log: Dataset, joined: Joined) -> float:
    """F at a join, by somebody who does hold all raw data."""
    values = joined.map.all_values
    return sum(float(t.loss.cost(np.sum(t.whitened(values) ** 2, -1)).sum()) for t in log.tables)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("order", ORDERS)
def test_the_gap_is_the_true_gap(world: str, order: str) -> None:
    log = team(world, sigma=0.1, sigma_odometry=0.1)
    members = built(log)
    joined = ORDERS[order]([submap for _, submap in members])
    exactness = with_exactness(joined, members).components[0].exactness
    assert exactness is not None
    best = full(log, initial=joined, options=TIGHT).map
    true_gap = (full_cost(log, joined) - best.cost) / full_cost(log, joined)
    assert exactness.relative_cost_gap == pytest.approx(true_gap, rel=0.2)
    assert 0.0 < exactness.max_shift_sigma <= exactness.gradient_norm
    assert exactness.rounds == 1 and exactness.bytes > 0


@pytest.mark.parametrize("world", WORLDS)
def test_under_robust_losses_it_is_of_the_right_size(world: str) -> None:
    """A sighting in the tail of its loss holds less firmly than Gauss-Newton believes."""
    log = team(world, robot_model="range", sigma=0.05).with_loss(Loss("huber", 2.0))
    members = built(log)
    joined = join(submap for _, submap in members)
    exactness = with_exactness(joined, members).components[0].exactness
    assert exactness is not None
    best = full(log, initial=joined, options=TIGHT).map
    true_gap = 1.0 - best.cost / full_cost(log, joined)
    assert 0.5 * true_gap < exactness.relative_cost_gap < 2.0 * true_gap


@pytest.mark.parametrize("world", WORLDS)
def test_the_log_at_the_map_says_the_same_as_the_pieces(world: str) -> None:
    """Where it holds more rows than the pieces at hand, it is not asked: those are none of this join's."""
    log = team(world, sigma=0.1, sigma_odometry=0.1)
    members = built(log)
    joined = join(submap for _, submap in members)
    alone = with_exactness(joined, members).components[0].exactness
    for tables in (log.tables, (*log.tables, log.tables[0])):
        found = with_exactness(joined, members, [AtMap(tables, joined.map)]).components[0].exactness
        assert found is not None and alone is not None
        assert found.relative_cost_gap == pytest.approx(alone.relative_cost_gap, rel=1e-6)
        assert found.max_shift_sigma == pytest.approx(alone.max_shift_sigma, rel=1e-6)
        assert found.bytes == alone.bytes


@pytest.mark.parametrize("world", WORLDS)
def test_an_exact_join_agrees_with_what_it_says_of_itself(world: str) -> None:
    log = team(world, sigma=0.1, sigma_odometry=0.1)
    members = built(log)
    exact = exact_join([piece for piece, _ in members], gap=1e-5)
    (itself,) = (component.exactness for component in exact.components)
    assert with_exactness(exact, members).components[0].exactness is itself
    forgotten = Joined(tuple(type(c)(c.map, c.solution, c.members) for c in exact.components))
    found = with_exactness(forgotten, members).components[0].exactness
    assert itself is not None and found is not None
    for name in ("relative_cost_gap", "gradient_norm", "max_shift_sigma"):
        assert getattr(found, name) == pytest.approx(getattr(itself, name), rel=1e-3)


def test_in_the_frame_of_the_world() -> None:
    log = team("2d", sigma=0.1, sigma_odometry=0.1)
    assert log.truth is not None
    marks = log.landmark_keys[:3, None]
    fixes = measure(1, "survey", "position", 2, marks, 0.05, log.truth, np.random.default_rng(0))
    log = log.with_tables([*log.tables, fixes])
    members = built(log)
    joined = join(submap for _, submap in members)
    exactness = with_exactness(joined, members).components[0].exactness
    assert joined.map.base < 0 and exactness is not None
    best = full(log, initial=joined, options=TIGHT).map
    assert exactness.relative_cost_gap == pytest.approx(1.0 - best.cost / full_cost(log, joined), rel=0.2)


def test_one_submap_alone_is_exact() -> None:
    log = team("3d", robots=1, sigma=0.1, sigma_odometry=0.1)
    members = [(piece, build(piece)) for piece in split(log)]
    exactness = with_exactness(join([members[0][1]]), members).components[0].exactness
    assert exactness is not None and exactness.relative_cost_gap < 1e-10 and exactness.bytes == 0


def test_without_every_piece_nobody_knows() -> None:
    members = built(team("2d"))
    joined = join(submap for _, submap in members)
    assert with_exactness(joined, members[1:]).components[0].exactness is None
    assert with_exactness(joined, []).components[0].exactness is None
    assert with_exactness(joined, members[::-1]).components[0].exactness is not None
