"""Sightings that look wrong are told by every run, and found where the map does not fit; right ones are not."""

import numpy as np
import pytest

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
    assert "look wrong" in dict(outcome(Record.of(result).report))["wrong"]


def _with_values(table, values: np.ndarray):
    from dataclasses import replace

    return replace(table, values=values)
