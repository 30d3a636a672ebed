"""Wrong sightings are found and right ones kept; with none that is wrong the log comes back as it is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teamslam.config import Config, TrustOptions, config_from, to_table
from teamslam.errors import InputError
from teamslam.geometry import BoolArray, IntArray
from teamslam.joining import build, join, split
from teamslam.model import Dataset, index_of, is_landmark, landmark_number
from teamslam.pipeline import run
from teamslam.results import write_run
from teamslam.results.report import report_of
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.faults import aliased
from teamslam.solver import System, optimise, optimise_graduated
from teamslam.trust import wrong_sightings
from teamslam.trust.outliers.gates import gates, noise_of, share_wrong
from teamslam.trust.outliers.words import sentences_on_sightings

SPACES = ("2d", "planar", "3d")


def scattered(space: str, share: float, of_robots: float, seed: int) -> tuple[Dataset, list[BoolArray]]:
    """False alarms, spread evenly over what a sensor could see, and which rows they are."""

    def log(landmarks: float, robots: float) -> Dataset:
        kind = Robot(landmarks=Sensor(outliers=landmarks), robots=Sensor("relative_pose", every=5, outliers=robots))
        return simulate(Options(space=space, robots=3, poses=40, landmarks=20, team=(kind,)), seed)

    clean, wrong = log(0.0, 0.0), log(share, of_robots)
    return wrong, [(a.values != b.values).any(1) for a, b in zip(clean.tables, wrong.tables, strict=True)]


@pytest.mark.parametrize("space", SPACES)
def test_a_clean_log_comes_back_as_it_is(space: str) -> None:
    log, _ = scattered(space, 0.0, 0.0, 1)
    found = wrong_sightings(log)
    assert found.rejected == 0 and found.kept(log) is log
    assert all(sensor.noise < 1.5 and sensor.wrong < 0.05 for sensor in found.sensors)


@pytest.mark.parametrize("space", SPACES)
def test_all_inliers_give_the_plain_optimum(space: str) -> None:
    log, _ = scattered(space, 0.0, 0.0, 2)
    assert log.truth is not None
    start = log.truth.only(log.layout.keys)
    fixed = log.pose_keys[1][:1]
    suspects = [n for n, table in enumerate(log.tables) if table.source != "odometry"]
    limits = {n: gates(log.tables[n], 0.05) for n in suspects}
    first = {n: np.arange(len(log.tables[n])) % 2 == 0 for n in suspects}
    system = System(start.layout, tables=log.tables, fixed=fixed)
    found = optimise_graduated(system, start, suspects, gates=limits, first=first)
    plain = optimise(System(start.layout, tables=log.tables, fixed=fixed), start)
    assert found.rejected == 0
    np.testing.assert_allclose(found.solution.values.minus(plain.values), 0.0, atol=1e-7)
    assert found.solution.cost == pytest.approx(plain.cost, rel=1e-12)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_scattered_false_alarms(space: str, share: float) -> None:
    log, wrong = scattered(space, share, 0.2, 3)
    found = wrong_sightings(log)
    right = np.concatenate([m[~w] for m, w in zip(found.inliers, wrong, strict=True)])
    bad = np.concatenate([m[w] for m, w in zip(found.inliers, wrong, strict=True)])
    assert (~right).sum() <= 0.02 * len(bad) and bad.mean() < 0.02
    for sensor in found.sensors:
        if sensor.source == "landmarks":
            assert sensor.wrong == pytest.approx(share, abs=0.12)
    assert sum(map(len, found.kept(log).tables)) == sum(map(len, log.tables)) - found.rejected


@pytest.mark.parametrize("space", SPACES)
def test_one_landmark_taken_for_another(space: str) -> None:
    log, wrong = aliased(simulate(Options(space=space, robots=4, landmarks=20), 1), 0.2, 0.3, 1)
    found = wrong_sightings(log)
    right = np.concatenate([m[~w] for m, w in zip(found.inliers, wrong, strict=True)])
    bad = np.concatenate([m[w] for m, w in zip(found.inliers, wrong, strict=True)])
    assert (~right).sum() <= 0.02 * len(bad) and bad.mean() < 0.03


@pytest.mark.parametrize("seed", range(3))
def test_what_landmarks_are_called_decides_nothing(seed: int) -> None:
    log, _ = aliased(simulate(Options(space="2d", robots=2, poses=60, landmarks=12), seed), 0.3, 0.0, seed)

    def called(keys: IntArray) -> IntArray:
        words = [landmark_number(f"L{key}") if is_landmark(key) else key for key in keys.ravel().tolist()]
        return np.array(words, np.int64).reshape(keys.shape)

    named = log.with_tables(replace(table, keys=called(table.keys)) for table in log.tables)
    numbers, words = wrong_sightings(log), wrong_sightings(named)
    assert numbers.rejected == words.rejected > 0
    for one, other in zip(numbers.inliers, words.inliers, strict=True):
        np.testing.assert_array_equal(one, other)
    undecided = [sorted((o.robot, o.larger, o.smaller) for o in found.open) for found in (numbers, words)]
    assert undecided[0] == undecided[1] and all(larger >= smaller or larger == 1 for _, larger, smaller in undecided[0])


def test_the_team_outvotes_a_robot_that_is_mostly_wrong() -> None:
    log = simulate(Options(space="planar", robots=4, landmarks=20), 1)
    assert log.truth is not None
    number = next(n for n, t in enumerate(log.tables) if (t.robot, t.source) == (1, "landmarks"))
    table = log.tables[number]
    marks, sightings = np.unique(table.keys[:, 1], return_counts=True)
    mark, ghost = (int(marks[place]) for place in np.argsort(-sightings)[:2])
    rows = np.flatnonzero(table.keys[:, 1] == mark)
    wrong = np.zeros(len(table), bool)
    wrong[rows[: int(0.7 * len(rows))]] = True
    keys = np.where((np.arange(2) == 1) & wrong[:, None], ghost, table.keys)
    seen = np.where(wrong[:, None], replace(table, keys=keys).predict(log.truth), table.values)
    lie = log.with_tables(replace(t, values=seen) if n == number else t for n, t in enumerate(log.tables))
    found = wrong_sightings(lie)
    assert not found.inliers[number][wrong].any() and found.inliers[number][~wrong].all()
    assert found.rejected == wrong.sum()


def test_the_gate_follows_the_probability_and_the_noise() -> None:
    table = next(t for t in simulate("2d", 1).tables if t.source == "landmarks")
    one, other = gates(table, 0.01), gates(table, 0.3)
    assert (one > other).all() and (other > 9.0).all()
    np.testing.assert_allclose(one - other, 2.0 * np.log((0.99 / 0.01) / (0.7 / 0.3)))
    assert (gates(table, 0.01, 4.0) > one).all()
    assert share_wrong(0, 10**6) == pytest.approx(1e-4) and share_wrong(300, 1000) == pytest.approx(0.295, abs=0.01)


def test_noise_is_estimated_beside_outliers() -> None:
    rng = np.random.default_rng(0)
    squared = np.sum((2.0 * rng.standard_normal((4000, 2))) ** 2, -1)
    squared[:1200] = rng.uniform(100.0, 1e4, 1200)
    assert noise_of(squared, np.full(4000, 2), 0.3) == pytest.approx(4.0, rel=0.1)
    assert noise_of(squared[:5], np.full(5, 2), 0.0) == 1.0


def test_a_run_lists_what_it_rejected(tmp_path: Path) -> None:
    log, wrong = scattered("planar", 0.2, 0.2, 5)
    result = run(log, Config(trust=TrustOptions(reject=True)))
    report = report_of(result)["rejected"]
    assert report["count"] == len(report["rows"]) == sum(sensor["rejected"] for sensor in report["sensors"])
    assert all(row["weight"] == 0.0 and row["squared"] > row["gate"] > 9.0 for row in report["rows"])
    listed = {(row["robot"], row["source"], row["row"]) for row in report["rows"]}
    planted = {
        (log.names.robot(t.robot), t.source, int(i)) for t, w in zip(log.tables, wrong, strict=True) for i in t.ids[w]
    }
    assert len(listed - planted) <= 0.02 * len(planted) and len(planted - listed) <= 0.02 * len(planted)
    write_run(result, tmp_path / "run", figures=False)
    kept = [t.select(~w) for t, w in zip(log.tables, wrong, strict=True)]
    oracle = join([build(piece) for piece in split(log.with_tables(kept))]).map
    apart = result.map.values.only(oracle.values.layout.keys).minus(oracle.values)
    assert np.sqrt(np.mean(apart**2)) < 0.02


def test_options_that_make_no_sense() -> None:
    with pytest.raises(InputError, match="between 0 and 1"):
        TrustOptions(reject=True, wrong=1.5)
    with pytest.raises(InputError, match="reject"):
        TrustOptions(wrong=0.1)
    config = Config(trust=TrustOptions(reject=True, wrong=0.2, repair=True))
    assert config_from(to_table(config)) == config


@pytest.mark.parametrize("space", ["2d", "planar"])
def test_no_landmark_is_lost_that_some_robot_saw_rightly_three_times(space: str) -> None:
    """Though another's only look at it was wrong, and drew it away."""

    def log(landmarks: float, robots: float) -> Dataset:
        kind = Robot(landmarks=Sensor(outliers=landmarks), robots=Sensor("relative_pose", every=5, outliers=robots))
        return simulate(Options(space=space, robots=4, team=(kind,)), 3)

    clean, seen = log(0.0, 0.0), log(0.1, 0.2)
    found = wrong_sightings(seen)
    kept = {key for table in found.kept(seen).tables for key in table.keys[:, -1].tolist()}
    for table, before in zip(seen.tables, clean.tables, strict=True):
        if table.source == "landmarks":
            marks, times = np.unique(table.keys[(table.values == before.values).all(1), 1], return_counts=True)
            assert {int(mark) for mark in marks[times >= 3]} <= kept
    assert found.undecided == 0


@pytest.mark.parametrize("seed", [6, 7])
def test_a_landmark_that_rests_on_one_of_several_sightings_is_named(seed: int) -> None:
    """All of these and no other ones; of a log without a wrong sighting none."""
    kind = Robot(landmarks=Sensor(outliers=0.3))
    log = simulate("2d", seed=seed, poses=30, landmarks=40, team=(kind,))
    found = wrong_sightings(log)
    seen = [(int(key), bool(right)) for table, mask in zip(log.tables, found.inliers, strict=True)
            if table.source == "landmarks" for key, right in zip(table.keys[:, 1], mask, strict=True)]  # fmt: skip
    votes = {mark: [right for key, right in seen if key == mark] for mark, _ in seen}
    contradicted = {mark: len(rights) - 1 for mark, rights in votes.items() if sum(rights) == 1 < len(rights)}
    assert contradicted
    assert {place.mark: place.smaller for place in found.open if place.larger == 1} == contradicted
    said = " ".join(sentences_on_sightings(found))
    assert all(f"landmark {found.names.landmark(int(index_of(mark)))} rests on one" in said for mark in contradicted)
    assert not wrong_sightings(simulate("2d", seed=seed, poses=30, landmarks=40)).open
