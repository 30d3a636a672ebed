"""Landmarks without names, on teams whose names were taken away: who is who is found out, or said to be open."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.geometry import Pose
from teamslam.io import read, write
from teamslam.metrics import score
from teamslam.model import Dataset, is_landmark, is_unnamed, unnamed_key
from teamslam.pipeline import run
from teamslam.sim import Options, Robot, Sensor, World, observe, simulate
from teamslam.trust.associate import Associated, associate
from teamslam.trust.associate.across import Constellation, motions
from teamslam.trust.associate.by_names import told_again
from teamslam.trust.associate.compatible import UNSURE
from teamslam.trust.associate.cooling import _are_ghosts, cooled
from thinned import thinned

ALONE = Robot(robots=None)  # sees no other robot


def nameless(log: Dataset, keep: int = 0) -> Dataset:
    """The log without the names of its landmarks, but for those whose number is below `keep`."""
    tables = []
    for table in log.tables:
        bare = is_landmark(table.keys[:, -1]) & (table.keys[:, -1] >= keep)
        keys = table.keys.copy()
        keys[bare, -1] = unnamed_key(table.robot, table.ids[bare])
        tables.append(replace(table, keys=keys))
    return log.with_tables(tables)


def compared(log: Dataset, found: Associated) -> tuple[np.ndarray, np.ndarray]:
    """Of every sighting that was kept the true landmark, and the one that it was given."""
    known = {(t.robot, t.source, n): k for t in log.tables for n, k in zip(t.ids.tolist(), t.keys[:, -1], strict=True)}
    true, given = [], []
    for table in found.dataset.tables:
        for number, key in zip(table.ids.tolist(), table.keys[:, -1].tolist(), strict=True):
            if is_landmark(key):
                true.append(known[table.robot, table.source, number])
                given.append(key)
    return np.array(true), np.array(given)


def precision(true: np.ndarray, given: np.ndarray) -> float:
    """The share of sightings that are with most of their own."""
    right = [np.unique(true[given == key], return_counts=True)[1].max() for key in np.unique(given)]
    return sum(right) / len(true)


def small(space: str, robots: Robot = ALONE, **more: object) -> Options:
    """Two robots among a dozen landmarks, whose start poses nobody knows."""
    return Options(space=space, robots=2, poses=25, landmarks=12, team=(robots,), side_m=9.0, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(("space", "seed"), thinned(3, ["2d", "planar", "3d"], [1, 2]))
def test_names_are_found_out(space: str, seed: int) -> None:
    """Within each way and across ways that nothing but their constellations ties."""
    log = simulate(small(space), seed=seed)
    found = associate(nameless(log))
    true, given = compared(log, found)
    assert precision(true, given) >= 0.99
    assert len(true) >= 0.9 * sum(int(is_landmark(t.keys[:, -1]).sum()) for t in log.tables)
    assert len(np.unique(given)) == len(np.unique(true)) == found.landmarks
    assert not found.rivals
    rows = sum(map(len, log.tables))
    assert rows == sum(map(len, found.dataset.tables)) + sum(d.count for d in found.dataset.dropped)


def test_the_map_is_as_good_as_with_names() -> None:
    """Robots' positions, against the truth."""
    log = simulate(small("2d"), seed=3)
    with_names, without = run(log), run(nameless(log))
    assert len(without.joined.components) == 1
    mine, best = (score(r.map, log.truth).accuracy.robot_position_rmse_m for r in (without, with_names))
    assert mine <= 1.2 * best


def test_some_with_names_and_some_without() -> None:
    """Names are kept, and lent to what is the same."""
    log = simulate(small("2d"), seed=1)
    bare = nameless(log, keep=4)
    half = bare.with_tables(
        replace(t, keys=np.where(is_unnamed(t.keys), t.keys, nameless(log).tables[n].keys))
        if t.robot == 2 and t.source == "landmarks"
        else t
        for n, t in enumerate(bare.tables)
    )
    found = associate(half)
    true, given = compared(log, found)
    assert precision(true, given) >= 0.99
    for label in range(4):
        of_one = given[true == label]
        assert np.mean(of_one == label) > 0.95


def bare_rows(log: Dataset, share: float, seed: int = 0, of: tuple[int, ...] | None = None) -> Dataset:
    """The log with a share of its sightings of landmarks (of these alone) without a name."""
    rng, tables = np.random.default_rng(seed), []
    for table in log.tables:
        target = table.keys[:, -1]
        some = is_landmark(target) if of is None else np.isin(target, of)
        some &= rng.random(len(table)) < share
        keys = table.keys.copy()
        keys[some, -1] = unnamed_key(table.robot, table.ids[some])
        tables.append(replace(table, keys=keys))
    return log.with_tables(tables)


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
@pytest.mark.parametrize("share", [0.01, 0.3])
def test_a_few_without_a_name_are_told_by_the_others(space: str, share: float) -> None:
    """They lend their names, at the cost of a few maps of the log: no way is followed pose by pose for them."""
    log = simulate(small(space), seed=2)
    bare = bare_rows(log, share)
    heard: list[tuple[int, int]] = []
    found = associate(bare, lambda done, of: heard.append((done, of)))
    assert 1 <= len(heard) <= 3
    true, given = compared(log, found)
    count = sum(int(is_unnamed(t.keys[:, -1]).sum()) for t in bare.tables)
    assert count > 0
    assert np.mean(true == given) >= 0.999
    assert len(true) >= sum(int(is_landmark(t.keys[:, -1]).sum()) for t in log.tables) - 0.1 * count
    assert found.landmarks == 0
    assert sum(map(len, log.tables)) == len_of(found.dataset)
    assert any("of landmarks with one" in note for note in found.dataset.notes)


def len_of(log: Dataset) -> int:
    return sum(map(len, log.tables)) + sum(d.count for d in log.dropped)


def test_a_false_alarm_without_a_name_is_of_none() -> None:
    """But of no landmark, and counted."""
    log = simulate(small("2d"), seed=2)
    bare = bare_rows(log, 0.02)
    tables, wrong = [], 0
    for table in bare.tables:
        some = is_unnamed(table.keys[:, -1])
        wrong += int(some.sum())
        values = table.values.copy()
        values[some, 0] += 25.0  # beyond all landmarks
        tables.append(replace(table, values=values))
    found = associate(bare.with_tables(tables))
    assert found.strangers == wrong > 0
    true, given = compared(log, found)
    np.testing.assert_array_equal(true, given)


def test_landmarks_without_a_name_beside_those_that_have_one() -> None:
    """Four of twelve are never named: they are found as they are, and nobody else's sightings go to them."""
    log = simulate(small("2d"), seed=3)
    never = tuple(sorted({int(k) for t in log.tables for k in t.keys[:, -1][is_landmark(t.keys[:, -1])]})[:4])
    found = associate(bare_rows(log, 1.0, of=never))
    true, given = compared(log, found)
    named = ~np.isin(true, never)
    np.testing.assert_array_equal(true[named], given[named])
    assert found.landmarks == len(never)
    assert precision(true, given) >= 0.99
    assert len(true) >= 0.9 * sum(int(is_landmark(t.keys[:, -1]).sum()) for t in log.tables)


def test_a_log_with_names_is_left_as_it_is() -> None:
    log = simulate(small("2d"), seed=1)
    assert associate(log).dataset is log


def grid(side: int) -> Pose:
    """Landmarks on a grid, alike in every direction."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(side) * 2.0, np.arange(side) * 2.0))
    return Pose(np.tile(np.eye(2), (len(x), 1, 1)), np.stack([x, y], -1) - (side - 1.0))


def test_a_repeated_pattern_is_left_open_and_said() -> None:
    """A square grid fits itself in four ways: nobody may take one of them silently."""
    xytheta = np.stack([np.linspace(-3, 3, 25), np.zeros(25), np.zeros(25)], -1)
    turned = np.stack([np.zeros(25), np.linspace(-3, 3, 25), np.full(25, np.pi / 2)], -1)
    world = World({1: Pose.from_xytheta(xytheta), 2: Pose.from_xytheta(turned)}, grid(4))
    eye = Robot(robots=None, landmarks=Sensor("range_bearing", range_m=12.0))
    log = observe(world, {1: eye, 2: eye}, 0)
    found = associate(nameless(log))
    true, given = compared(log, found)
    assert precision(true, given) >= 0.99  # within each way all is clear
    assert len(found.rivals) == 1
    assert len(found.rivals[0].motions) >= 4
    odds = [motion.odds for motion in found.rivals[0].motions]
    assert max(odds) < 0.9
    assert sum(odds) <= 1.0 + 1e-9
    assert any("may lie to each other" in note for note in found.dataset.notes)


@pytest.mark.slow
def test_false_alarms_are_of_no_landmark() -> None:
    """And are counted."""
    sensor = Sensor("range_bearing", sigma_m=0.05, sigma_rad=0.01, outliers=0.05)
    log = simulate(small("2d", Robot(landmarks=sensor, robots=None)), seed=4)
    found = associate(nameless(log))
    true, given = compared(log, found)
    assert precision(true, given) >= 0.98
    assert found.strangers > 0


@pytest.mark.slow
def test_close_groups_of_a_real_log_come_apart(data: Callable[[str], Path]) -> None:
    """MRCLAM 6: fifteen landmarks in groups of two and three, 0.2 m apart, seen by cameras that call depth a range."""
    log = read(data("mrclam_6"))
    found = associate(nameless(log))
    true, given = compared(log, found)
    assert precision(true, given) >= 0.99
    assert len(np.unique(true)) == 15 <= found.landmarks <= 17
    assert len(true) >= 0.6 * sum(int(is_landmark(t.keys[:, -1]).sum()) for t in log.tables)
    with_names, without = run(log), run(nameless(log))
    mine, best = (score(r.map, log.truth).accuracy.robot_position_rmse_m for r in (without, with_names))
    assert mine <= 1.2 * best


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
def test_a_team_that_sees_itself_is_told_at_once(space: str) -> None:
    """Far fewer names than sightings, and no two of one image the same."""
    log = simulate(small(space, Robot()), seed=5)
    told = cooled(nameless(log))
    assert told is not None and not told.rough and set(told.marks) == set(log.robots)
    true, given = compared(log, associate(nameless(log)))
    assert precision(true, given) >= 0.98
    assert len(true) >= 0.7 * sum(int(is_landmark(t.keys[:, -1]).sum()) for t in log.tables)


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
def test_what_is_left_open_is_told_by_the_map_of_what_was_told(space: str) -> None:
    """A third of the sightings forgotten again: they find back to their landmarks, and the others stay with theirs."""
    log = nameless(simulate(small(space, Robot()), seed=6))
    team, rng = cooled(log), np.random.default_rng(0)
    assert team is not None
    told = team.marks
    open_ = {robot: (rng.random(len(marks)) < 0.3) & (marks >= 0) for robot, marks in told.items()}
    again = told_again(log, {robot: np.where(open_[robot], UNSURE, marks) for robot, marks in told.items()})
    for robot, marks in told.items():
        stayed, found = (marks >= 0) & ~open_[robot], open_[robot] & (again[robot] >= 0)
        np.testing.assert_array_equal(again[robot][stayed], marks[stayed])
        assert found.sum() >= 0.9 * open_[robot].sum()
        assert np.mean(again[robot][found] == marks[found]) >= 0.98


def test_what_is_laid_nearer_than_images_show_is_the_same_seen_from_elsewhere() -> None:
    """Three landmarks 2.5 m apart, two in each image. Laid from ways that are 0.6 m off in half of the images they look
    like six; groups that stand as close as that and are seen together are no such thing."""
    rng = np.random.default_rng(0)
    three = np.array([[0.0, 0.0], [2.5, 0.0], [0.0, 2.5]])
    which = np.concatenate([rng.permutation(3)[:2] for _ in range(200)])
    images = np.repeat(np.arange(200), 2)
    off = np.where(images[:, None] % 2, 0.6, 0.0) + 0.05 * rng.standard_normal((400, 2))
    there = np.concatenate([three, three + 0.6])
    assert _are_ghosts(three[which] + off, which + 3 * (images % 2), there, images)
    close = np.concatenate([three, three + 0.2])
    every = np.stack([which[::2], which[::2] + 3], 1).ravel()
    assert not _are_ghosts(close[every] + 0.05 * rng.standard_normal((400, 2)), every, close, images)
    assert not _are_ghosts(three[which], which, three, images)


@pytest.mark.parametrize("dim", [2, 3])
def test_constellations_are_matched_however_they_lie(dim: int) -> None:
    """Against the motion and the pairs that were planted, strangers among them; a mirror image is refused."""
    rng = np.random.default_rng(dim)
    places = rng.uniform(-5.0, 5.0, (12, dim))
    pose = Pose.scattered(rng.uniform(-9.0, 9.0, (1, dim)), rng)[0]
    noise = 0.02

    def constellation(points: np.ndarray, first: int) -> Constellation:
        n = len(points)
        covariance = (noise**2 * np.eye(n * dim)).reshape(n, dim, n, dim)
        seen = points + noise * rng.standard_normal(points.shape)
        return Constellation(first + np.arange(n), np.full(n, -1), seen, covariance, dim)

    order = rng.permutation(12)[:9]
    others = np.concatenate([pose.unact(places[order]), rng.uniform(-5.0, 5.0, (4, dim))])
    best = motions(constellation(places, 0), constellation(others, 100))[0]
    assert best.odds > 0.99
    np.testing.assert_allclose(best.pose.translation, pose.translation, atol=0.1)
    assert {(int(order[k]), 100 + k) for k in range(9)} <= {(int(a), int(b)) for a, b in best.pairs}
    mirrored = others * np.array([-1.0] + [1.0] * (dim - 1))
    assert all(m.odds < 0.5 for m in motions(constellation(places, 0), constellation(mirrored, 100)))


def test_an_empty_cell_is_a_sighting_without_a_name(tmp_path: Path) -> None:
    """In the plain format, there and back."""
    log = nameless(simulate(small("2d"), seed=1), keep=3)
    write(log, tmp_path / "log", "plain")
    again = read(tmp_path / "log")
    for mine, theirs in zip(log.tables, again.tables, strict=True):
        named = ~is_unnamed(mine.keys[:, -1])
        np.testing.assert_array_equal(mine.keys[named], theirs.keys[named])
        assert is_unnamed(theirs.keys[~named, -1]).all()
        assert len(np.unique(theirs.keys[~named, -1])) == int((~named).sum())
        np.testing.assert_allclose(mine.values, theirs.values)
