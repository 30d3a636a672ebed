"""Names that lie are found, named and put right; the map after is the map without the fault."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.io import read
from teamslam.joining import build, join, split
from teamslam.model import Dataset, Submap
from teamslam.sim import Options, simulate
from teamslam.sim.faults import exchanged, moved, taken_for_another
from teamslam.trust import mended, suspicions
from teamslam.trust.labels.alignment import Stars, closely, roughly
from teamslam.trust.labels.constellations import constellations, renamed
from teamslam.trust.labels.robots import mistaken_robots
from teamslam.trust.labels.search import Finding, mislabelled
from teamslam.trust.labels.words import sentence_on_label

SPACES = ("2d", "planar", "3d")


def submaps_of(log: Dataset) -> list[Submap]:
    return [build(piece) for piece in split(log)]


def team(space: str, seed: int) -> Dataset:
    return simulate(Options(space=space, robots=4, landmarks=20), seed)


@given(seed=st.integers(0, 50), space=st.sampled_from(SPACES))
def test_an_exchange_twice_is_none(seed: int, space: str) -> None:
    submap = build(split(simulate(Options(space=space, robots=1, poses=8, landmarks=10), seed))[0])
    marks = submap.landmark_keys
    if len(marks) < 2:
        return
    names = {int(marks[0]): int(marks[-1]), int(marks[-1]): int(marks[0])}
    once = renamed(submap, names)
    twice = renamed(once, names)
    np.testing.assert_array_equal(twice.values.state, submap.values.state)
    assert (twice.information != submap.information).nnz == 0
    for key, name in names.items():
        np.testing.assert_array_equal(
            once.values.positions(np.array([name]), 3), submap.values.positions(np.array([key]), 3)
        )
        np.testing.assert_array_equal(once.information_of(np.array([name])), submap.information_of(np.array([key])))


def test_renaming_a_submap_is_building_it_from_renamed_rows() -> None:
    log = team("planar", 1)
    one, other = (int(k) for k in submaps_of(log)[0].landmark_keys[:2])
    mine = renamed(submaps_of(log)[0], {one: other, other: one})
    theirs = submaps_of(exchanged(log, 1, one, other))[0]
    np.testing.assert_allclose(mine.values.minus(theirs.values), 0.0, atol=1e-6)
    np.testing.assert_allclose(mine.information.toarray(), theirs.information.toarray(), rtol=1e-5, atol=1e-2)


@pytest.mark.parametrize("space", SPACES)
def test_a_constellation_on_itself_costs_nothing(space: str) -> None:
    own = constellations(submaps_of(team(space, 2)))[1][0]
    stars = Stars.of(own, 2 if space == "2d" else 3)
    same = np.arange(len(stars.keys))[None]
    rough, frames = roughly(stars, stars, same, own.base_dim)
    assert rough[0] < 1e-12
    fit = closely(stars, stars, same[0], frames[0])
    assert fit.cost < 1e-9 and fit.dof == stars.places.size - frames.dof


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seed", range(3))
def test_right_names_are_left_alone(space: str, seed: int) -> None:
    assert mislabelled(submaps_of(team(space, seed))) == []


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seed", range(3))
def test_exchanged_names_are_found_and_put_right(space: str, seed: int) -> None:
    log, robot = team(space, seed), 1 + seed
    submaps = submaps_of(log)
    others = np.concatenate([s.landmark_keys for s in submaps if robot not in s.robots])
    known = np.intersect1d(submaps[robot - 1].landmark_keys, others)
    one, other = (int(k) for k in np.random.default_rng(seed).choice(known, 2, replace=False))
    lie = exchanged(log, robot, one, other)
    lying = submaps_of(lie)
    found = suspicions(lie, lying, join(lying))
    assert [label.change.kind for label in found.labels] == ["exchanged"] and not found.liars
    label = found.labels[0]
    assert {label.change.one, label.change.other} == {one, other}
    assert robot in (label.change.robot, *label.instead)
    assert label.odds > np.log(1000.0)
    again = mended(lie, found)
    if label.change.robot == robot:
        for mine, theirs in zip(again.tables, log.tables, strict=True):
            np.testing.assert_array_equal(mine.keys, theirs.keys)
    mine, theirs = (join(submaps_of(of)) for of in (again, log))
    assert mine.components[0].solution is not None and theirs.components[0].solution is not None
    assert mine.components[0].solution.cost == pytest.approx(theirs.components[0].solution.cost, rel=1e-6)


@pytest.mark.parametrize("space", SPACES)
def test_a_landmark_that_was_moved_is_two(space: str) -> None:
    log = team(space, 0)
    marks, seers = np.unique(np.concatenate([s.landmark_keys for s in submaps_of(log)]), return_counts=True)
    mark = int(marks[np.argmax(seers)])
    by = np.array([1.0, 0.0, 0.0])[: 2 if space == "2d" else 3]
    lie = moved(log, (2,), mark, by)
    submaps = submaps_of(lie)
    found = suspicions(lie, submaps, join(submaps))
    assert [(label.change.kind, label.change.one) for label in found.labels] == [("apart", mark)]
    assert found.labels[0].apart_m == pytest.approx(1.0, abs=0.3)
    again = join(submaps_of(mended(lie, found))).map
    assert np.isin([mark, found.labels[0].change.other], again.landmark_keys).all()


def test_the_words_name_who_and_what() -> None:
    log = team("planar", 1)
    first, second, *rest = (submap.landmark_keys for submap in submaps_of(log))
    one, other = (int(k) for k in np.intersect1d(second, np.concatenate([first, *rest]))[:2])
    lie = exchanged(log, 2, one, other)
    submaps = submaps_of(lie)
    found = suspicions(lie, submaps, join(submaps))
    said = list(found.sentences())
    assert len(said) == 1 and said == [sentence_on_label(found.labels[0], log.names)]
    assert f"landmark {one}" in said[0] and f"landmark {other}" in said[0] and "robot 2" in said[0]
    assert "odds " in said[0] and said[0].endswith(")")


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("seed", range(3))
def test_robots_that_are_taken_for_each_other(space: str, seed: int) -> None:
    """Found by what nobody's sightings of robots have bent, and put right: the map is that of the right names."""
    log = simulate(Options(space=space, robots=3, landmarks=15, side_m=8.0), seed)
    assert mistaken_robots(log, submaps_of(log), join(submaps_of(log))) == []
    lie = taken_for_another(log, 1, 2, 3)
    found = suspicions(lie, submaps_of(lie))
    assert {(m.by, m.named, m.right) for m in found.mistaken} == {(1, 2, 3), (1, 3, 2)}
    assert not found.labels and not found.liars
    mine, theirs = (join(submaps_of(of)).map for of in (mended(lie, found), log))
    np.testing.assert_allclose(mine.values.minus(theirs.values), 0.0, atol=1e-5)
    assert "robot 1 takes robot 3 for robot 2" in next(iter(found.sentences()))


def planted_pairs(path: Path, pairs: int) -> tuple[list[Finding], list[tuple[tuple[int, int, int], list[Finding]]]]:
    submaps = submaps_of(read(path))
    rng = np.random.default_rng(0)
    found = []
    for _ in range(pairs):
        one, other = (int(k) for k in rng.choice(submaps[0].landmark_keys, 2, replace=False))
        robot = int(rng.integers(1, 6))
        names = {one: other, other: one}
        lying = [renamed(s, names) if robot in s.robots else s for s in submaps]
        found.append(((robot, *sorted((one, other))), mislabelled(lying)))
    return mislabelled(submaps), found


@pytest.mark.parametrize("name", [6, pytest.param(9, marks=pytest.mark.slow)])
def test_real_teams(data: Callable[[str], Path], name: int) -> None:
    clean, planted = planted_pairs(data(f"mrclam_{name}"), 5)
    assert clean == []
    for (robot, one, other), found in planted:
        assert len(found) == 1
        change = found[0].change
        assert (change.kind, change.robot, *sorted((change.one, change.other))) == ("exchanged", robot, one, other)
