"""Noise that is larger than stated accuses nobody for good: once it is put right, what it explains is said so."""

import faults
from teamslam.pipeline import run
from teamslam.sim import Options, simulate


def test_robots_that_contradict_each_other_by_stated_noise_alone_are_said_to() -> None:
    """Odometry six times as bad as stated, in two honest robots: their map holds what its covariances promise, and it
    is not said that one of them must be wrong."""
    log = simulate(Options(space="2d", robots=2), 1)
    result = run(faults.plant(log, faults.surer(6.0), source="odometry"))
    (said,) = result.suspicions.sentences()
    assert "by the noise as it is stated" in said and "no more once it is put right" in said
    assert not result.suspicions.judgement.undecidable
    assert result.scores[0].nees_per_dof < 1.3
