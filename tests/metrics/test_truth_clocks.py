"""The clock of a truth, its drift with it, by all that a map knows; with what is known of both."""

import numpy as np
import pytest
import scipy.sparse as sp

from teamslam.frontend.clock import Clock
from teamslam.geometry import Pose
from teamslam.metrics import align_team, score, truth_clocks
from teamslam.model import Kind, Names, Sources, Submap, Values, index_of, pose_key

SECONDS, SHAKES = 40.0, 1.5
TICKS = np.round(np.arange(0.0, SECONDS, 0.4) * 1e6).astype(np.int64)
SPAN = int(TICKS[0] + TICKS[-1]) // 2, float(TICKS[-1] - TICKS[0]) * 1e-6


def way(ticks, shakes=SHAKES):
    """Where a robot truly is, that drives round and looks to both sides; as far into the hour as it may be."""
    t = ticks * 1e-6
    heading = 0.3 * t + shakes * np.sin(1.3 * t)
    return Pose.from_xytheta(np.stack([2.0 * np.cos(0.3 * t), 1.5 * np.sin(0.3 * t), heading], -1))


def truth_by(planted, shakes=SHAKES):
    """The truth as the motion capture's clock has it, asked by any clock: at `planted` it is right."""

    def asked(clocks):
        parts = []
        for robot in (1, 2):
            clock = clocks.get(robot, Clock(SPAN[0]))
            parts.append((pose_key(robot, TICKS), way(planted[robot].team(clock.own(TICKS)) + robot * 10**7, shakes)))
        keys = np.concatenate([keys for keys, _ in parts])
        rotation, place = (np.concatenate([getattr(p, f) for _, p in parts]) for f in ("rotation", "translation"))
        return Values.of({Kind.POSE2: (keys, Pose(rotation, place))})

    return asked


def mapped(seed, place_m=0.003, turn_rad=0.001, shakes=SHAKES):
    """A map of two robots that errs as its information says."""
    right = truth_by({1: Clock(SPAN[0]), 2: Clock(SPAN[0])}, shakes)({})
    base = int(right.layout.keys[0])
    values = right.transform(right.pose(base).inverse())
    values = values.select(values.layout.keys != base)
    sigma = np.tile([place_m, place_m, turn_rad], values.layout.dof // 3)
    values = values.retract(sigma * np.random.default_rng(seed).normal(size=len(sigma)))
    information = sp.csr_array(np.diag(sigma**-2.0))
    return Submap("map", 0, base, 2, values, information, Sources(), Names({}))


PLANTED = {1: Clock(SPAN[0]), 2: Clock(SPAN[0], 0.1234, -50e-6)}


def found(map, planted=PLANTED, near=None, shakes=SHAKES):
    near = {1: 0.0, 2: planted[2].offset_s + 0.004} if near is None else near
    return truth_clocks(map, {1: SPAN, 2: SPAN}, near, truth_by(planted, shakes))


def test_offset_and_drift_are_found_within_their_sigmas_and_the_truth_fits_by_them():
    z, honest, by_offset_alone = [], [], []
    for seed in range(20):
        map = mapped(seed)
        late = found(map)
        assert late[2].drift != 0.0 and late[2].drift_sigma < 10e-6 and late[2].sigma_s < 2e-4
        z.append([(late[2].value_s - 0.1234) / late[2].sigma_s, (late[2].drift + 50e-6) / late[2].drift_sigma])
        moved = truth_by(PLANTED)({robot: one.clock for robot, one in late.items()})
        assert align_team(map, moved) is not None
        honest.append(score(map, moved).nees_per_dof)
        by_offset_alone.append(score(map, truth_by(PLANTED)({2: Clock(SPAN[0], 0.1234)})).nees_per_dof)
    assert np.abs(z).max() < 4.0 and np.all(np.mean(np.square(z), 0) < 2.0) and np.all(np.mean(np.square(z), 0) > 0.4)
    assert np.mean(honest) == pytest.approx(1.0, abs=0.03)
    assert np.mean(by_offset_alone) > np.mean(honest) + 0.05


def test_a_clock_in_time_is_said_to_be_late_in_few_maps_only():
    right = {1: Clock(SPAN[0]), 2: Clock(SPAN[0])}
    told = [found(mapped(seed), right) for seed in range(30)]
    assert sum(map(bool, told)) <= 2


def test_a_drift_that_the_map_does_not_tell_is_left_at_nothing():
    """A robot that drives smoothly, known to some centimetres and degrees."""
    late = found(mapped(3, 0.03, 0.03), {1: Clock(SPAN[0]), 2: Clock(SPAN[0], 0.3, 5e-6)})
    assert set(late) == {2} and late[2].drift == 0.0 and late[2].drift_sigma > 5e-6
    assert abs(late[2].value_s - 0.3) < 4.0 * late[2].sigma_s


def test_where_truth_is_farther_from_the_map_than_that_allows_sigmas_are_wider():
    """Maps that are five times as far off as they say."""
    z = []
    for seed in range(15):
        map = mapped(seed, 0.015, 0.005)
        sure = Submap("map", 0, map.base, 2, map.values, 25.0 * map.information, Sources(), Names({}))
        late = found(sure)[2]
        z.append((late.value_s - 0.1234) / late.sigma_s)
    assert np.mean(np.square(z)) < 2.5


def test_who_knows_nothing_of_the_truth_says_nothing():
    assert found(mapped(0), near={}) == {}
    assert truth_clocks(mapped(0), {1: SPAN}, {1: 0.0}, lambda clocks: None) == {}
    assert index_of(mapped(0).keys).max() == TICKS[-1]
