"""Exact joining on published logs equals full least squares that started elsewhere: costs, and every estimate."""

from collections.abc import Callable
from pathlib import Path

import pytest

import teamslam
from joining.exact.test_rounds import assert_law
from thinned import thinned


@pytest.mark.parametrize("name", thinned(3, ["mrclam5a.pyfg", "mrclam_6", "mrclam_1"]))
def test_exact_joining_is_full_least_squares(name: str, data: Callable[[str], Path]) -> None:
    """The PyFG piece ties robots by ranges beside weak landmarks: its residuals bend, and one direction is weak."""
    assert_law(teamslam.read(data(name)), sigma=1e-3)


def test_ranges_join_robots_that_share_too_few_landmarks(data: Callable[[str], Path]) -> None:
    """Robots B and C of the PyFG piece: two landmarks a hand apart, and sightings good to half a metre."""
    dataset = teamslam.read(data("mrclam5a.pyfg"))
    assert dataset.truth is not None
    joined = teamslam.join([teamslam.build(piece) for piece in teamslam.split(dataset)])
    (component,) = joined.components
    assert component.solution is not None and component.solution.converged
    report = teamslam.score(component.map, dataset.truth)
    assert report.robot_position_rmse_m is not None and report.robot_position_rmse_m < 0.3
