"""Exact joining on published logs equals full least squares that started elsewhere: costs, and every estimate."""

from collections.abc import Callable
from pathlib import Path

import pytest

import teamslam
from joining.test_exact import assert_law


@pytest.mark.parametrize("name", ["mrclam5a.pyfg", "mrclam_6", "mrclam_1"])
def test_exact_joining_is_full_least_squares(name: str, data: Callable[[str], Path]) -> None:
    """The PyFG piece ties robots by ranges beside weak landmarks: its residuals bend, and one direction is weak."""
    assert_law(teamslam.read(data(name)), sigma=1e-3)
