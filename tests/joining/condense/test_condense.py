"""Condensing is exact: joined from condensed submaps, the map is the map, on the separators and, recovered, within."""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from teamslam.errors import ModelError
from teamslam.geometry import AnyArray
from teamslam.joining import build, join, split
from teamslam.joining.condense.condense import (
    Interior,
    condense,
    condense_partially,
    expand,
    separators,
)
from teamslam.joining.condense.worth import worth_eliminating
from teamslam.model import Kind, Layout, Submap, is_landmark
from teamslam.solver import Condensed, Covariances, Options
from worlds import WORLDS, team

TO_THE_END = Options(decrement=1e-12, cost_share=0.0)
Condensing = Callable[[Submap, AnyArray], tuple[Submap, Interior]]
CONDENSINGS: dict[str, Condensing] = {"condense": condense, "condense_partially": condense_partially}
TEAMS = [(world, "relative_pose") for world in WORLDS] + [("2d", "range_bearing")]


def submaps_of(world: str, robot_model: str = "relative_pose", **options: int) -> list[Submap]:
    log = team(world, poses=10, landmarks=4, robot_model=robot_model, sees=0.6, **options)
    return [build(piece, options=TO_THE_END) for piece in split(log, poses_per_piece=6)]


@pytest.mark.parametrize("how", CONDENSINGS)
@pytest.mark.parametrize(("world", "robot_model"), TEAMS)
def test_joined_condensed_equals_joined_whole(world: str, robot_model: str, how: str) -> None:
    submaps = submaps_of(world, robot_model)
    needed = separators(submaps)
    parts = [CONDENSINGS[how](submap, needed[submap.id]) for submap in submaps]
    assert sum(small.dof for small, _ in parts) < sum(submap.dof for submap in submaps)

    whole = join(submaps, options=TO_THE_END).map
    joined = join([small for small, _ in parts], options=TO_THE_END).map
    assert_allclose(whole.values.only(joined.values.layout.keys).minus(joined.values), 0.0, atol=1e-9)
    assert_allclose(joined.cost, whole.cost, rtol=1e-11)
    assert joined.rows - joined.dof == whole.rows - whole.dof

    restored = expand(joined, [interior for _, interior in parts])
    assert_allclose(restored.values.minus(whole.values), 0.0, atol=1e-9)
    assert restored.rows == whole.rows
    scale = abs(whole.information).max()
    assert_allclose(restored.information.toarray(), whole.information.toarray(), atol=1e-8 * scale)
    wanted, found = Covariances.of_map(whole).all, Covariances.of_map(restored).all
    for a, b in zip(wanted, found, strict=True):
        assert_allclose(b, a, rtol=1e-6, atol=1e-7 * np.abs(a).max())


@pytest.mark.parametrize("world", WORLDS)
def test_marginals_of_what_was_kept_do_not_change(world: str) -> None:
    submap = submaps_of(world)[0]
    keep = submap.values.layout.keys[::3]
    small, _ = condense(submap, keep)
    whole = Covariances.of_map(submap)
    for key in small.values.layout.keys.tolist():
        assert_allclose(Covariances.of_map(small).of(key), whole.of(key), rtol=1e-7, atol=1e-12)


def test_recovered_without_others_the_interior_is_as_it_was() -> None:
    submap = submaps_of("planar")[0]
    small, interior = condense(submap, submap.landmark_keys)
    assert_allclose(interior.recover(small).minus(submap.values.only(interior.keys)), 0.0, atol=1e-12)


@pytest.mark.parametrize("world", WORLDS)
def test_condensing_in_two_steps_is_condensing_at_once(world: str) -> None:
    submap = submaps_of(world)[0]
    some, few = submap.values.layout.keys[::2], submap.values.layout.keys[::4]
    twice = condense(condense(submap, some)[0], few)[0]
    once = condense(submap, few)[0]
    assert_allclose(twice.information.toarray(), once.information.toarray(), rtol=1e-8, atol=1e-8)


def test_separators_are_what_two_submaps_or_raw_rows_name() -> None:
    submaps = submaps_of("2d", "range_bearing")
    needed = separators(submaps)
    for submap in submaps:
        own = set(submap.values.layout.keys.tolist())
        others = set(np.concatenate([s.keys for s in submaps if s is not submap]).tolist())
        raw = {int(k) for s in submaps for t in s.raw for k in t.keys.ravel()}
        assert set(needed[submap.id].tolist()) == own & (others | raw)
    alone = separators(submaps[:1], landmarks=True)[submaps[0].id]
    assert set(submaps[0].landmark_keys.tolist()) <= set(alone.tolist())


def test_what_raw_measurements_name_is_not_condensed_away() -> None:
    submap = next(s for s in submaps_of("2d", "range_bearing") if s.raw)
    with pytest.raises(ModelError, match="which would be condensed away"):
        condense(submap, submap.landmark_keys)


def test_an_interior_is_recovered_only_from_a_map_it_hangs_on() -> None:
    first, second, *_ = submaps_of("2d")
    _, interior = condense(first, first.landmark_keys)
    with pytest.raises(ModelError, match="does not hold"):
        interior.recover(condense(second, second.values.layout.keys[:0])[0])


@pytest.mark.parametrize("seed", range(5))
def test_partial_condensation_never_grows_the_message(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 30
    layout = Layout.of(np.arange(n), np.full(n, int(Kind.POINT2)))
    root = sp.random_array((60, 2 * n), density=0.05, rng=rng).toarray()
    information = sp.csr_array(root.T @ root + np.kron(np.diag(rng.random(n)), np.ones((2, 2))) + np.eye(2 * n))
    candidates = rng.random(n) < 0.8
    gone = worth_eliminating(layout, information, candidates)
    assert not gone[~candidates].any()
    rest = Condensed(layout, information, gone).information
    assert len(sp.triu(rest).data) <= len(sp.triu(information).data)
    inner = np.repeat(gone, 2)
    dense = information.toarray()
    solved = np.linalg.solve(dense[np.ix_(inner, inner)], dense[np.ix_(inner, ~inner)])
    expected = dense[np.ix_(~inner, ~inner)] - dense[np.ix_(~inner, inner)] @ solved
    assert_allclose(rest.toarray(), expected, atol=1e-12)


def test_a_chain_between_two_ends_shrinks_to_one_coupling() -> None:
    n = 50
    layout = Layout.of(np.arange(n), np.full(n, int(Kind.POINT2)))
    step = sp.diags_array([np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1], shape=(n - 1, n))
    information = sp.csr_array(sp.kron(step.T @ step + sp.diags_array(np.full(n, 1e-3)), np.eye(2)))
    inner = np.ones(n, bool)
    inner[[0, -1]] = False
    assert (worth_eliminating(layout, information, inner) == inner).all()


def test_landmarks_stay_landmarks() -> None:
    submaps = submaps_of("2d")
    small, _ = condense(submaps[0], separators(submaps, landmarks=True)[submaps[0].id])
    assert is_landmark(small.values.layout.keys).any()
    assert small.base == submaps[0].base
    assert small.sources == submaps[0].sources
