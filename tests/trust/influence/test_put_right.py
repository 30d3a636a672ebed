"""Robots whose submaps carry systematic errors are judged as others are."""

import numpy as np
import pytest

from teamslam.joining import join
from teamslam.model import is_parameter
from teamslam.pipeline import run
from teamslam.trust.influence.liars import liars
from teamslam.trust.influence.parts import Problem
from trust.calibration.faulty import offset, team


def test_small_submaps_with_systematic_errors_of_their_own_are_a_problem_too() -> None:
    """So small that nothing is eliminated of them, what they carry stands in the join. (ModelError: a variable is not
    among those of this layout.)"""
    log, _ = offset(team(0), np.random.default_rng(0))
    submaps = run(log).submaps
    assert any(is_parameter(submap.keys).any() for submap in submaps)
    joined = join(submaps)
    problem = Problem.of(submaps, joined.map)
    assert problem.cost == pytest.approx(joined.map.cost - sum(submap.cost for submap in submaps), rel=1e-6)
    assert liars(submaps, joined) is not None
