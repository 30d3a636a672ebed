"""Sightings that look wrong are told by every run, and found where the map does not fit; right ones are not."""

from dataclasses import replace

import numpy as np
import pytest

import faults
from teamslam.model import Loss
from teamslam.pipeline import run
from teamslam.results import Record
from teamslam.results.words import outcome
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.trust.outliers.glance import at_a_glance


def log_with(share: float, space: str = "2d", seed: int = 3):
    kind = Robot(landmarks=Sensor(outliers=share), robots=Sensor("relative_pose", every=5, outliers=share))
    return simulate(Options(space=space, robots=4, team=(kind,)), seed)


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
@pytest.mark.parametrize("seed", range(2))
def test_of_a_right_model_nothing_looks_wrong(space: str, seed: int) -> None:
    found = run(simulate(Options(space=space, robots=4), seed))
    assert at_a_glance(found.verdict.rows) == ()
    assert Record.of(found).report["rejected"] is None


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_a_default_run_finds_which_are_wrong_and_leaves_them(share: float) -> None:
    """The map is that of all; the words say how many are wrong, and what to do; no sigma is blamed for them."""
    clean, log = log_with(0.0), log_with(share)
    result = run(log)
    decisions = result.trust.wrong.decisions
    wrong = [(a.values != b.values).any(1) for a, b in zip(clean.tables, log.tables, strict=True)]
    hits = sum(int((~kept & bad).sum()) for kept, bad in zip(decisions.inliers, wrong, strict=True))
    planted = sum(int(bad.sum()) for bad in wrong)
    assert hits >= 0.97 * planted and decisions.rejected <= 1.05 * planted
    assert result.decisions is None and result.verdict.gross
    report = Record.of(result).report
    assert report["rejected"]["left_out"] is False and len(report["rejected"]["rows"]) == decisions.rejected
    words = dict(outcome(report))
    assert "--reject" in words["wrong"] and f"{decisions.rejected:,} of" in words["wrong"]
    assert [cause["kind"] for cause in report["fit"]["causes"]] == ["outliers"]


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
@pytest.mark.parametrize("seed", range(4))
def test_numbers_that_were_misread_are_named_and_nobody_is_suspected_for_them(space: str, seed: int) -> None:
    """One to three sightings of one robot bear the number of another landmark that it knows, under a loss that
    forgives, as images of tags have it: what is said is said of them."""
    log = simulate(Options(space=space, robots=3), 100 + seed)
    forgiving = (t if t.source == "odometry" else replace(t, loss=Loss("cauchy", 3.0)) for t in log.tables)
    log = log.with_tables(forgiving)
    table = next(t for t in log.tables if t.source == "landmarks" and t.robot == 1 + seed % 3)
    rng = np.random.default_rng(seed)
    rows, keys = rng.choice(len(table), 1 + seed % 3, replace=False), table.keys.copy()
    for row in rows.tolist():
        known = [key for key in log.landmark_keys if np.sum(table.keys[:, 1] == key) > 3]
        keys[row, 1] = rng.choice(np.setdiff1d(known, table.keys[table.keys[:, 0] == table.keys[row, 0], 1]))
    result = run(log.with_tables([replace(t, keys=keys) if t is table else t for t in log.tables]))
    told = "; ".join(result.trust.wrong.sentences())
    for row in rows.tolist():
        assert " from ".join(log.names.describe(int(key)) for key in keys[row, ::-1]) in told
    assert list(result.trust.suspicions.sentences()) == []


def test_where_most_are_far_off_none_is_called_wrong() -> None:
    """Sigmas that are far too small, such as variances in their place: every sighting is as right as the others."""
    log = simulate(Options(space="2d", robots=2, poses=25, landmarks=12), 1)
    result = run(faults.plant(log, faults.surer(50.0)))
    report = Record.of(result).report
    assert report["fit"]["gross"] and report["rejected"]["count"] is None and "rows" not in report["rejected"]
    assert "nobody can tell which sightings are wrong" in dict(outcome(report))["wrong"]


def test_a_few_that_look_wrong_where_the_map_fits_are_counted() -> None:
    """A single row far off: a glance is enough, and nothing is searched for."""
    log = log_with(0.0)
    table = next(t for t in log.tables if t.source == "landmarks")
    values = table.values.copy()
    values[5] += 0.5
    moved = log.with_tables([*(t for t in log.tables if t is not table), _with_values(table, values)])
    result = run(moved)
    assert not result.verdict.gross and result.trust.wrong.decisions is None
    report = Record.of(result).report["rejected"]
    assert report["count"] >= 1 and "rows" not in report
    assert "wrong at this map" in dict(outcome(Record.of(result).report))["wrong"]


def _with_values(table, values: np.ndarray):
    return replace(table, values=values)


def test_tags_that_a_robot_carries_and_nobody_says_so_are_named(tmp_path):
    """Cubes of tags on two robots that the team file does not know: no place fits them, and all others have theirs."""
    import re

    import tagged_room
    import teamslam as ts

    team = tagged_room.write(tagged_room.make(seconds=40.0, rate=3.0), tmp_path)
    team.write_text(re.sub(r"\[\[robot.tag\]\]\n(?:.+\n){3}", "", team.read_text()))
    wrong = run(ts.read(team)).trust.wrong
    assert all("of robot robot" in told and ", front" in told for told in [*wrong.sentences()][:-1])
    said = [sentence for sentence in wrong.sentences() if sentence.startswith("no place fits")]
    assert len(said) == 1
    named = {int(number) for number in re.findall(r"\d+", said[0].split(" sightings")[0].rsplit(", ", 1)[0])}
    carried = {number for cube in tagged_room.CUBES for number in cube}
    assert named and named <= carried
