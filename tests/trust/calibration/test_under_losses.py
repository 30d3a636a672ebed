"""A right model is left alone under losses that forgive as well: what they weigh rows by is no news of their noise."""

import pytest

import teamslam as ts
from teamslam.config import Config
from teamslam.model import Loss
from teamslam.sim import Options, simulate


@pytest.mark.parametrize("loss", [Loss("cauchy", 1.0), Loss("cauchy", 2.0), Loss("huber", 1.0)], ids=str)
def test_the_noise_of_right_teams_stays_what_it_is(loss: Loss) -> None:
    """Odometry that was taken to be a hundred times as sure as it is made NEES of thousands of what should be 1."""
    for seed in range(3):
        log = simulate(Options(space="2d", robots=3, poses=100, landmarks=20), seed)
        found = ts.run(log, Config(loss=loss)).scores[0].nees_per_dof
        assert found is not None and found < 1.3
