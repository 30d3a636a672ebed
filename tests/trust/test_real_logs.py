"""Logs of real robots: their verdicts are calm, and no mistake is found that nobody made."""

from collections.abc import Callable
from pathlib import Path

import pytest

import teamslam as ts
from teamslam.joining import build, join, split
from teamslam.trust.causes.search import mistakes_of_robots

LEVELS = {
    "mrclam_1": {"fits"},
    "mrclam_6": {"fits"},
    "mrclam_7": {"fits"},
    "mrclam_9": {"fits", "strained"},
    "mrclam5a.pyfg": {"loose"},  # sigmas of 0.5 m, where ranges are good to centimetres
    "plaza2.pyfg": {"fits"},
    "parking-garage.g2o": {"loose"},
    "distributed_mapper_4robots": {"loose"},
    "islsjf_535": {"fits"},
}


@pytest.mark.parametrize("name", LEVELS)
def test_real_logs_fit_or_nearly(data: Callable[[str], Path], name: str) -> None:
    """No sign, unit, axis, clock or landmark is blamed, and none is a gross misfit."""
    log = ts.read(data(name))
    found = ts.verdict(log, join([build(piece) for piece in split(log)]))
    assert found.level in LEVELS[name]
    assert not [cause.sentence for cause in found.causes if cause.is_mistake]


def test_victoria_park_is_known_better_than_it_says(data: Callable[[str], Path]) -> None:
    """Its clean log: the published chi-square is a tenth of its degrees of freedom."""
    log = ts.read(data("islsjf_vicpark_200") / "VicPark_clean_data.mat")
    found = ts.verdict(log, join([build(piece) for piece in split(log)]))
    assert found.level == "loose" and found.cost < 0.2 * found.expected and not found.causes


@pytest.mark.parametrize("name", ["plaza2.pyfg", "mrclam5a.pyfg", "mrclam_9", "parking-garage.g2o"])
def test_no_mistake_is_seen_without_a_map_either(data: Callable[[str], Path], name: str) -> None:
    """As for logs that cannot be solved. Ranges of Plaza 2 shrunk to nothing cost nothing, which is no explanation."""
    log = ts.read(data(name))
    assert not mistakes_of_robots(log, log.robots)


def test_smooth_ranges_between_robots_that_odometry_can_follow_are_not_called_exact(
    data: Callable[[str], Path],
) -> None:
    """Of one robot's ranges of another 0.02 cm were made, and NEES/dof of 661."""
    found = ts.run(data("mrclam5a.pyfg"))
    (score,) = found.scores
    assert score.nees_per_dof is not None and score.nees_per_dof < 8.0
