"""The screen: right models pass it untouched, and what it stops is worth a closer look."""

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.joining import AtMap, full
from teamslam.model import Dataset
from teamslam.pipeline import run
from teamslam.trust.calibration.screen import SUSPICION, suspicious
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


@pytest.mark.parametrize("method", ["join", "full"])
def test_a_right_model_is_left_alone_to_the_bit(method: str) -> None:
    log = team(51, poses=40)
    asked, stated = (run(log, Config(method=method, calibrate=calibrate)) for calibrate in (True, False))
    assert asked.calibration is not None and not asked.calibration and stated.calibration is None
    assert np.array_equal(asked.map.values.state, stated.map.values.state)
    assert (asked.map.information != stated.map.information).nnz == 0
    assert asked.verdict.cost == stated.verdict.cost
