"""A start is a guess: it may be rough, it never ends a run."""

from pathlib import Path

import pytest

from stress.scenario import draw
from stress.world import log_of
from teamslam.config import Config, JoinOptions
from teamslam.io import read
from teamslam.joining import build_choices, split
from teamslam.model import is_landmark
from teamslam.pipeline import run
from thinned import thinned


@pytest.mark.parametrize(
    "config",
    thinned(3, [Config(), Config(join=JoinOptions(exact=True)), Config(method="full")]),
    ids=["join", "exact", "full"],
)
def test_a_piece_that_creeps_ends_no_run(data, config: Config) -> None:
    """MRCLAM 7 holds seven poses whose robust least squares creeps; they are only a start for their robot's map."""
    log: Path = data("mrclam_7")
    result = run(read(log), config)
    assert result.joined.converged
    assert len(result.joined.components) == 1
    (score,) = result.scores
    assert score.robot_position_rmse_m is not None and score.robot_position_rmse_m <= 0.075
    assert score.landmark_rmse_m is not None and score.landmark_rmse_m <= 0.05


@pytest.mark.slow
def test_a_log_whose_odometry_turns_too_far_maps(data) -> None:
    """MRCLAM 9: behind barriers the robots turned by two thirds of what was commanded, so headings are soon lost."""
    result = run(read(data("mrclam_9")))
    assert result.joined.converged
    assert len(result.joined.components) == 1
    (score,) = result.scores
    assert score.landmark_rmse_m is not None and score.landmark_rmse_m <= 0.04


@pytest.mark.parametrize("seed, has_bare", [(2000345, False), (2000382, True)])
def test_what_a_piece_cannot_tell_travels_raw(seed: int, has_bare: bool) -> None:
    """In the second of these logs pieces have no optimum that is found: they are their robot's way alone. In the first
    they had none before a search went on from elsewhere. No row is lost in either."""
    bare = 0
    for piece in split(log_of(draw(seed))):
        first, *_ = build_choices(piece)
        assert first.rows + sum(t.dof for t in first.raw) == sum(t.dof for t in piece.tables)
        bare += not is_landmark(first.keys).any() and any(t.source == "landmarks" for t in piece.tables)
    assert bool(bare) == has_bare
