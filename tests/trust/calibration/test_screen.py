"""The screen: right models pass it untouched, and what it stops is worth a closer look."""

from dataclasses import replace

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.joining import AtMap, full
from teamslam.model import Dataset
from teamslam.pipeline import run
from teamslam.sim import simulate
from teamslam.trust.calibration.screen import SUSPICION, _look, suspicious
from trust.calibration.faulty import FAULTS, team


def _is_suspicious(log: Dataset) -> bool:
    return suspicious(AtMap(log.tables, full(log).map))


def test_right_models_are_looked_at_no_more_often_than_stated() -> None:
    teams = 40
    looked_at = sum(_is_suspicious(team(300 + seed, poses=25)) for seed in range(teams))
    assert looked_at <= SUSPICION * teams + 3.0 * np.sqrt(SUSPICION * teams)


@pytest.mark.parametrize("fault", [name for name in FAULTS if name != "nothing"])
def test_whatever_is_wrong_is_looked_at(fault: str) -> None:
    assert all(_is_suspicious(FAULTS[fault](team(seed), np.random.default_rng(seed))) for seed in range(2))


def _long(seed: int) -> Dataset:
    return simulate("2d", seed, robots=3, poses=3000, landmarks=150)


@pytest.mark.parametrize("seed", [7, 9])  # something of the first windows stands out by chance
def test_what_stands_out_of_a_long_log_by_chance_is_asked_again(seed: int) -> None:
    assert not _is_suspicious(_long(seed))


def test_what_is_wrong_in_a_long_log_stands_out_again() -> None:
    log = _long(0)
    wrong = [replace(t, whitening=t.whitening / 0.93) if t.source == "landmarks" else t for t in log.tables]
    assert _is_suspicious(log.with_tables(wrong))


def test_some_rows_show_what_they_show_among_all() -> None:
    log = team(17, poses=30)
    at = AtMap(log.tables, full(log).map)
    measured = [at.gap.system.whitened(place, at.values) for place in range(len(at.tables))]
    some = [np.arange(len(u)) % 3 == 0 for u in measured]
    part, whole = (
        _look(at, measured, np.random.default_rng(0), 4, seen)
        for seen in (some, [np.ones(len(u), bool) for u in measured])
    )
    for seen, (mine, theirs) in zip(some, zip(part, whole, strict=True), strict=True):
        assert np.array_equal(mine.table.ids, theirs.table.ids[seen])
        for name in ("errors", "sizes", "weight", "rate"):
            np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name)[seen], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("method", ["join", "full"])
def test_a_right_model_is_left_alone_to_the_bit(method: str) -> None:
    log = team(51, poses=40)
    asked, stated = (run(log, Config(method=method, calibrate=calibrate)) for calibrate in (True, False))
    assert asked.calibration is not None and not asked.calibration and stated.calibration is None
    assert np.array_equal(asked.map.values.state, stated.map.values.state)
    assert (asked.map.information != stated.map.information).nnz == 0
    assert asked.verdict.cost == stated.verdict.cost
