"""Landmarks that were moved are two in the map; and who lies is judged beside what explains a misfit."""

import re
from dataclasses import replace

import numpy as np
import pytest

import faults
from planted import TABLES
from teamslam.model import Dataset, landmark_number
from teamslam.pipeline import run
from teamslam.sim import simulate
from teamslam.trust.causes.apart import Apart
from teamslam.trust.causes.places import FEWEST
from thinned import thinned

ALL = (1, 2, 3)


def moved_in(log: Dataset) -> tuple[Dataset, int]:
    """The log with its landmark that is seen most moved by a metre half way, and which that is."""
    tables = [t for t in log.tables if t.source == "landmarks"]
    mark = int(np.argmax(np.bincount(np.concatenate([t.keys[:, -1] for t in tables]))))
    by = np.array([0.8, 0.6, 0.0])[: tables[0].dim]
    return faults.landmark_moved(log, mark, by, ALL, after=0.5), mark


def test_rows_stay_as_they_are_but_for_their_names() -> None:
    """In their order, with their numbers; a log that does not see the landmark is left alone."""
    log = simulate("planar", 3)
    rng = np.random.default_rng(0)
    mark = int(log.landmark_keys[2])
    mine = [t for t in log.tables if t.source == "landmarks"]
    second = [(t.keys[:, -1] == mark) & (rng.random(len(t)) < 0.5) for t in mine]
    mend = Apart.of(mark, mine, second, earlier=True)
    found = mend(log)
    one, other = (landmark_number(f"{mark} at place {n}") for n in (1, 2))
    assert {found.names.landmark(one), found.names.landmark(other)} == {f"{mark} at place 1", f"{mark} at place 2"}
    masks = iter(second)
    for before, after in zip(log.tables, found.tables, strict=True):
        assert np.array_equal(before.values, after.values) and np.array_equal(before.whitening, after.whitening)
        there = next(masks) if before.source == "landmarks" else np.zeros(len(before), bool)
        own = before.keys[:, -1] == mark
        assert np.array_equal(after.keys[:, -1], np.where(there, other, np.where(own, one, before.keys[:, -1])))
    assert mend(found) is found


@pytest.mark.parametrize(("preset", "seed"), [("2d", 3), ("planar", 4), ("3d", 5)])
def test_a_moved_landmark_bends_no_map_and_accuses_nobody(preset: str, seed: int) -> None:
    """The map fits, and is as far from the truth as without the fault, to within a tenth of it and its sigmas; the
    truth of the number counts for neither place."""
    log = simulate(preset, seed)
    moved, mark = moved_in(log)
    result, honest = run(moved), run(log)
    assert not honest.apart
    (cause,) = result.apart
    words = cause.sentence.split()
    assert f"landmark {mark} " in cause.sentence
    assert float(words[words.index("m") - 1]) == pytest.approx(1.0, abs=0.1)
    assert result.verdict.level in ("fits", "loose") and not result.verdict.causes
    assert not [*result.suspicions.sentences()]
    found, true = result.scores[0], honest.scores[0]
    assert found.accuracy.landmarks == true.accuracy.landmarks - 1
    assert found.nees_per_dof == pytest.approx(true.nees_per_dof, rel=0.2)
    assert found.robot_position_rmse_m < 1.3 * true.robot_position_rmse_m


def moved_at_once(log: Dataset, share: float, seed: int) -> tuple[Dataset, set[tuple[int, int]]]:
    """The log with a share of its landmarks moved by .8 m half way; and which robots saw which of those often both
    before and after."""
    marks = np.random.default_rng(seed).permutation(log.landmark_keys)[: round(share * len(log.landmark_keys))]
    seen = [t for t in log.tables if t.source == "landmarks"]
    often: set[tuple[int, int]] = set()
    for n, mark in enumerate(marks.tolist()):
        by = 0.8 * np.array([np.cos(n), np.sin(n), 0.0])[: seen[0].dim]
        log = faults.landmark_moved(log, mark, by, ALL, after=0.5)
        for table in seen:
            chain, mine = log.pose_keys[table.robot], table.keys[table.keys[:, -1] == mark, 0]
            late = mine >= chain[int(0.5 * (len(chain) - 1))]
            if min(late.sum(), (~late).sum()) >= 2 * FEWEST:
                often.add((table.robot, mark))
    return log, often


def strangers(log: Dataset) -> Dataset:
    """The same team, but that no robot ever saw another, and each calls its landmarks by names of its own."""
    tables = [replace(t, keys=t.keys + t.robot * np.array([0, 1000])) for t in log.tables if t.source == "landmarks"]
    return replace(log.with_tables([*(t for t in log.tables if t.source == "odometry"), *tables]), truth=None)


@pytest.mark.parametrize(("preset", "seed"), thinned(2, ["2d", "planar", "3d"], [1, 2]))
@pytest.mark.parametrize("one_map", [True, False])
def test_of_many_that_were_moved_at_once_each_is_named(preset: str, seed: int, one_map: bool) -> None:
    """A quarter of all, in one map, and in maps that nothing ties: all that a robot saw often in both places."""
    log = simulate(preset, seed, landmarks=60, poses=150)
    moved, often = moved_at_once(log, 0.25, seed)
    assert len(often) > 3
    result = run(moved if one_map else strangers(moved))
    assert result.verdict.level in ("fits", "loose", "strained")
    found = {int(number) for cause in result.apart for number in re.findall(r"landmark (\d+) ", cause.sentence)}
    assert {mark + (0 if one_map else 1000 * robot) for robot, mark in often} <= found


@pytest.mark.parametrize(("preset", "name"), thinned(4, ["2d", "planar", "3d"], ["degrees", "feet", "axes"]))
def test_nobody_is_suspected_of_what_a_mistake_explains(preset: str, name: str) -> None:
    """A robot whose sightings are in other units is told to be that, and not to lie as well."""
    fault, _ = TABLES[name]
    source = "odometry" if name == "degrees" else "landmarks"
    result = run(faults.plant(simulate(preset, 3), fault(), source=source, robots=(2,)))
    assert [cause.robots for cause in result.verdict.causes] == [(2,)]
    assert not [*result.suspicions.sentences()]


def test_a_landmark_that_one_robot_alone_has_elsewhere_is_one_of_its_own() -> None:
    """It may as well be another landmark that the robot calls so: to all others it is where it was."""
    log = simulate("planar", 3)
    _, mark = moved_in(log)
    who = next(t.robot for t in log.tables if t.source == "landmarks" and np.sum(t.keys[:, -1] == mark) > 15)
    result = run(faults.landmark_moved(log, mark, np.array([0.8, 0.6, 0.0]), (who,)))
    (cause,) = result.apart
    assert cause.kind == "place" and f"robot {who} sees landmark {mark} 1.0" in cause.sentence
    assert mark in result.dataset.landmark_keys and len(result.dataset.landmark_keys) == len(log.landmark_keys) + 1
    assert not [*result.suspicions.sentences()]
