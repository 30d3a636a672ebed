"""Sightings that go wrong one by one, as a loss expects, accuse no robot, and hide none that lies."""

import pytest

from teamslam.joining import build, join, split
from teamslam.model import SQUARED, Dataset, Loss
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.faults import stretched
from teamslam.trust import suspicions
from teamslam.trust.influence import liars
from teamslam.trust.influence.scattered import without_scattered

MISREADS = Robot(
    landmarks=Sensor("range_bearing", outliers=0.15), robots=Sensor("range_bearing", every=3, outliers=0.15)
)


def misread(robots: int, seed: int) -> Dataset:
    """A team of which 15 % of all sightings are anything, under Huber's loss."""
    log = simulate(Options(space="2d", robots=robots, poses=60, landmarks=12, team=(MISREADS,)), seed)
    forgiven = log.with_loss(Loss("huber", 2.0))
    return forgiven.with_tables(t.with_loss(SQUARED) if t.source == "odometry" else t for t in forgiven.tables)


@pytest.mark.parametrize(("robots", "seed"), [(3, 0), (3, 1), (3, 3), (3, 4), (3, 6), (3, 7), (4, 2), (4, 3), (4, 7)])
def test_misreads_of_all_accuse_nobody(robots: int, seed: int) -> None:
    log = misread(robots, seed)
    submaps = [build(piece) for piece in split(log)]
    found = suspicions(log, submaps, join(submaps))
    assert found.judgement is not None and found.liars == ()
    assert not found.judgement.alternatives and not found.judgement.undecidable


@pytest.mark.parametrize(("robots", "seed"), [(3, 1), (3, 2), (4, 0), (4, 2)])
def test_a_liar_among_misreads_is_found(robots: int, seed: int) -> None:
    liar = 1 + seed % robots
    submaps = [build(piece) for piece in split(stretched(misread(robots, seed), liar, 1.1))]
    found = liars(submaps, join(submaps))
    assert found.accused == (liar,) and found.significance < 1e-10


def test_under_a_squared_loss_every_row_is_evidence() -> None:
    submaps = [build(piece) for piece in split(misread(3, 0).with_loss(SQUARED))]
    assert without_scattered(submaps, join(submaps)) is None
