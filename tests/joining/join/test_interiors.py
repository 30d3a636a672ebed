"""Interiors are eliminated before a join and put back after it: nothing but the time may tell."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from teamslam.joining import ORDERS, Joined, build, join, split
from teamslam.joining.join import interiors
from teamslam.joining.join.interiors import members_of
from teamslam.model import Dataset, Loss, Submap
from teamslam.solver import Covariances, Options
from worlds import WORLDS, mixed_team, team

TO_THE_END = Options(decrement=1e-11, cost_share=0.0)


def submaps_of(log: Dataset, poses_per_piece: int | None = None) -> list[Submap]:
    return [build(piece, options=TO_THE_END) for piece in split(log, poses_per_piece=poses_per_piece)]


def both_ways(submaps: Sequence[Submap], order: Callable[..., Joined] = join) -> tuple[Joined, Joined]:
    """The join without interiors, and that of the whole submaps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interiors, "worth_it", lambda inside, unknowns: inside > 0)
        spared = order(submaps, options=TO_THE_END)
        patch.setattr(interiors, "worth_it", lambda inside, unknowns: inside < 0)
        return spared, order(submaps, options=TO_THE_END)


def spared_unknowns(submaps: Sequence[Submap]) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interiors, "worth_it", lambda inside, unknowns: inside > 0)
        return sum(member.whole.dof - member.joined.dof for member in members_of(submaps))


def assert_same(spared: Joined, whole: Joined) -> None:
    assert [c.members for c in spared.components] == [c.members for c in whole.components]
    assert spared.reasons == whole.reasons
    for one, other in zip(spared.components, whole.components, strict=True):
        a, b = one.map, other.map
        np.testing.assert_array_equal(a.values.layout.keys, b.values.layout.keys)
        apart = a.values.minus(b.values)
        assert np.sqrt(apart @ (b.information @ apart)) < 1e-9  # sigma, of any combination of variables
        assert_allclose(a.information.toarray(), b.information.toarray(), atol=1e-7 * abs(b.information).max())
        for mine, theirs in zip(Covariances.of_map(a).all, Covariances.of_map(b).all, strict=True):
            assert_allclose(mine, theirs, atol=1e-6 * np.abs(theirs).max())
        assert_allclose([a.cost, a.chi2], [b.cost, b.chi2], rtol=1e-9, atol=1e-12)
        assert (a.rows, a.sources, a.base, a.id, len(a.raw)) == (b.rows, b.sources, b.base, b.id, len(b.raw))
        assert (one.solution is None) == (other.solution is None)
        if one.solution is not None and other.solution is not None:
            assert (one.solution.rows, one.solution.dof) == (other.solution.rows, other.solution.dof)
            np.testing.assert_array_equal(one.solution.values.layout.keys, other.solution.values.layout.keys)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("world", WORLDS)
def test_every_order_of_joining(world: str, order: str) -> None:
    submaps = submaps_of(team(world, poses=14, every=5, landmarks=5))
    assert spared_unknowns(submaps) > 50
    assert_same(*both_ways(submaps, ORDERS[order]))


@pytest.mark.parametrize("world", WORLDS)
def test_submaps_in_chains(world: str) -> None:
    submaps = submaps_of(team(world, robots=2, poses=24), poses_per_piece=8)
    assert len(submaps) == 6 and spared_unknowns(submaps) > 0
    assert_same(*both_ways(submaps))


@pytest.mark.parametrize("loss", ["squared", "huber", "cauchy"])
@pytest.mark.parametrize("robot_model", ["relative_pose", "range_bearing", "bearing"])
def test_raw_sightings_and_robust_losses(robot_model: str, loss: str) -> None:
    log = team("2d", poses=14, robot_model=robot_model, every=4)
    submaps = submaps_of(log if loss == "squared" else log.with_loss(Loss(loss, 2.0)))
    assert (robot_model == "relative_pose" and loss == "squared") or any(submap.raw for submap in submaps)
    assert spared_unknowns(submaps) > 0
    assert_same(*both_ways(submaps))


def test_robots_of_the_ground_and_of_the_air() -> None:
    submaps = submaps_of(mixed_team())
    assert spared_unknowns(submaps) > 0
    assert_same(*both_ways(submaps))


def test_a_submap_that_shares_its_frame_alone() -> None:
    """Another robot sees the first pose of its way and nothing else: all of it but the frame is interior."""
    log = team("2d", robots=2, poses=12, landmarks=4)
    first = log.pose_keys[2][0]
    tables = [t.select((t.keys[:, 1] == first) | (t.robot == 2)) if t.source == "robots" else t for t in log.tables]
    alone = log.with_tables(
        t for t in tables if not (t.robot == 2 and t.source != "odometry") and not (t.robot == 1 and not len(t))
    )
    submaps = submaps_of(alone)
    assert len(submaps) == 2 and spared_unknowns(submaps[1:]) == 0
    spared, whole = both_ways(submaps)
    assert len(spared.components) == 1
    assert_same(spared, whole)


def test_submaps_that_share_nothing_come_back_as_they_are() -> None:
    log = team("2d", robots=2, landmarks=4)
    apart = log.with_tables(t for t in log.tables if t.source == "odometry")
    submaps = submaps_of(apart)
    spared, whole = both_ways(submaps)
    assert_same(spared, whole)
    assert [c.map for c in spared.components] == submaps


@given(
    st.sampled_from(WORLDS),
    st.integers(2, 4),
    st.integers(6, 30),
    st.sampled_from([None, 4, 9]),
    st.integers(2, 9),
    st.integers(0, 2**20),
)
def test_any_team(world: str, robots: int, poses: int, pieces: int | None, every: int, seed: int) -> None:
    log = team(world, robots=robots, poses=poses, every=every, landmarks=5, sigma=0.01, sigma_odometry=0.01, seed=seed)
    assert_same(*both_ways(submaps_of(log, poses_per_piece=pieces)))


def test_few_interiors_are_carried_along() -> None:
    submaps = submaps_of(team("planar"))
    assert all(member.interior is None for member in members_of(submaps))
    long = submaps_of(team("2d", robots=2, poses=80, every=20))
    assert all(member.interior is not None for member in members_of(long))
    assert all(member.joined.information.nnz < member.whole.information.nnz for member in members_of(long))
