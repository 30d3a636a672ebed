"""Steps and points that are written in the frame of the odometry are told, and brought back."""

import numpy as np
import pytest

import faults
from teamslam.oddities import oddities
from teamslam.sim import Options, simulate
from teamslam.trust.causes.frames import with_points_seen_from_it, with_steps_in_its_axes

LOG = simulate(Options(space="2d", robots=2, poses=40), 5)


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_steps_in_axes_that_do_not_turn_are_told(heading: float) -> None:
    """However the robot stood at first. Brought back they are what they were but for one turn of all of them, by as
    much as the robot drifts aside."""
    log = faults.in_the_frame_of_odometry(LOG, 2, steps=True, heading=heading)
    (said,) = oddities(log)
    assert "robot 2, odometry: steps are written in axes that do not turn with the robot" in said
    both = zip(with_steps_in_its_axes(log, 2).tables, LOG.tables, strict=True)
    for back, meant in both:
        assert np.allclose(back.values, meant.values, atol=0.02)


def test_points_in_the_frame_of_odometry_are_told() -> None:
    """And are seen from the robot again."""
    log = faults.in_the_frame_of_odometry(LOG, 1)
    (said,) = oddities(log)
    assert "robot 1, sightings of landmarks: places are those in the frame of its odometry" in said
    for back, meant in zip(with_points_seen_from_it(log, 1, "landmarks").tables, LOG.tables, strict=True):
        assert np.allclose(back.values, meant.values, atol=1e-9)


def test_where_nothing_is_wrong_steps_stay_but_for_one_turn() -> None:
    """Undoing what was not done is no small change: it is told from noise."""
    turned = with_steps_in_its_axes(LOG, 1)
    assert not np.allclose(turned.tables[0].values, LOG.tables[0].values, atol=0.1)
    assert not [*oddities(LOG)]
