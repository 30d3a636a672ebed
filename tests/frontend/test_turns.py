"""How late stamps are, by turns alone: wherever the camera is, and however the tag stands."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.frontend.shifts import STEP_S
from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.frontend.turns import LONGEST_S, lateness, turns_between
from teamslam.geometry import Pose, so3

T = np.arange(0.0, 30.0, 0.02)


def heading(t):
    return 0.8 * np.sin(1.3 * t) + 0.4 * np.sin(3.1 * t + 1.0)


def turning(angles):
    return so3.exp(np.stack([0.0 * angles, 0.0 * angles, angles], -1))


TRACK = Track(np.round(T * TICKS_PER_S).astype(np.int64), Pose(turning(heading(T)), np.zeros((len(T), 3))))


@settings(max_examples=20, deadline=None)
@given(st.floats(-0.8, 0.8), st.integers(0, 2**31))
def test_an_offset_is_found_to_a_step(late, seed):
    rng = np.random.default_rng(seed)
    seen = np.sort(rng.uniform(1.0, 29.0, 80))
    mount, tag = so3.exp(rng.normal(size=3)), so3.exp(rng.normal(size=3))
    rotations = mount.T @ np.swapaxes(turning(heading(seen)), -1, -2) @ tag
    rotations = rotations @ so3.exp(0.01 * rng.normal(size=(80, 3)))
    ticks = np.round((seen + late) * TICKS_PER_S).astype(np.int64)
    turns = turns_between(ticks, np.zeros(80, np.int64), rotations)
    assert (turns.stop - turns.start <= LONGEST_S * TICKS_PER_S).all()
    found = lateness(turns, TRACK)
    assert abs(late) < 2 * STEP_S if found is None else abs(found - late) < 2.0 * STEP_S


def test_who_does_not_turn_tells_nothing():
    ticks = np.round(np.arange(1.0, 29.0, 0.3) * TICKS_PER_S).astype(np.int64)
    rotations = so3.exp(0.01 * np.random.default_rng(1).normal(size=(len(ticks), 3)))
    still = Track(TRACK.ticks, Pose.identity(3, (len(T),)))
    assert lateness(turns_between(ticks, np.zeros(len(ticks), np.int64), rotations), still) is None
    assert lateness(turns_between(ticks[:3], np.zeros(3, np.int64), rotations[:3]), TRACK) is None
