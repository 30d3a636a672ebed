"""A start is a guess: it may be rough, it never ends a run."""

from pathlib import Path

import pytest

from teamslam.config import Config, JoinOptions
from teamslam.io import read
from teamslam.pipeline import run


@pytest.mark.parametrize(
    "config", [Config(), Config(join=JoinOptions(exact=True)), Config(method="full")], ids=["join", "exact", "full"]
)
def test_a_piece_that_creeps_ends_no_run(data, config: Config) -> None:
    """MRCLAM 7 holds seven poses whose robust least squares creeps; they are only a start for their robot's map."""
    log: Path = data("mrclam_7")
    result = run(read(log), config)
    assert result.joined.converged
    assert len(result.joined.components) == 1
    assert result.report is not None
    assert result.report.robot_position_rmse_m <= 0.075
    assert result.report.landmark_rmse_m is not None and result.report.landmark_rmse_m <= 0.05
