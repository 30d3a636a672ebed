"""Clocks: there and back is where one was."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from teamslam.frontend.clock import Clock


@given(st.integers(0, 10**12), st.floats(-10.0, 10.0), st.floats(-1e-3, 1e-3), st.lists(st.integers(0, 10**12)))
def test_there_and_back_is_the_same_to_a_tick(middle, offset, drift, ticks):
    clock = Clock(middle, offset, drift)
    ticks = np.array(ticks, np.int64)
    assert np.all(np.abs(clock.team(clock.own(ticks)) - ticks) <= 2)


def test_in_the_middle_stamps_are_late_by_the_offset_and_a_minute_later_by_the_drift_too():
    clock = Clock(1_000_000_000, 0.25, 50e-6)
    there = clock.own(np.array([999_750_000, 1_059_750_000]))
    np.testing.assert_array_equal(there, [1_000_000_000, 1_060_003_000])
