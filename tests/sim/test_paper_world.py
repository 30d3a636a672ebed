"""The paper's section 3.1: what is in range, what each scenario keeps, and that both fix the map."""

import numpy as np
import pytest

from teamslam.metrics import cramer_rao
from teamslam.model import robot_of
from teamslam.sim import NOISE_LEVELS, SCENARIOS, PaperOptions, simulate

POSES = (2, 4, 12)


@pytest.mark.parametrize("poses", POSES)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_setting_is_the_papers(scenario: str, poses: int) -> None:
    """Three robots on the ground, three landmarks at 2 m, sensors at 1 m that see 3 m far."""
    dataset = simulate(PaperOptions(scenario, poses), 0)
    assert dataset.robots == {1: 2, 2: 2, 3: 2} and len(dataset.landmark_keys) == 3
    assert all(len(keys) == poses for keys in dataset.pose_keys.values())
    assert dataset.truth is not None
    assert np.allclose(dataset.truth.positions(dataset.landmark_keys, 3)[:, 2], 2.0)
    for table in dataset.tables:
        if table.source == "landmarks":
            assert table.sensor is not None and np.allclose(table.sensor.translation, [0.0, 0.0, 1.0])
            seen = table.predict(dataset.truth)
            assert np.allclose(seen[:, 2], 1.0) and np.linalg.norm(seen, axis=-1).max() <= 3.0
        if table.source == "robots":
            assert np.linalg.norm(table.predict(dataset.truth)[:, :2], axis=-1).max() <= 3.0


@pytest.mark.parametrize("poses", POSES)
def test_minimum_keeps_first_and_last_sightings_and_two_of_robots(poses: int) -> None:
    """A part of the sufficient scenario, with the same noise."""
    least, all_of_it = (simulate(PaperOptions(s, poses), 1) for s in SCENARIOS)
    for table in least.tables:
        whole = next(t for t in all_of_it.tables if (t.robot, t.source) == (table.robot, table.source))
        assert np.array_equal(table.values, whole.values[table.ids])
        if table.source == "landmarks":
            for landmark in np.unique(whole.keys[:, 1]):
                kept, there = (t.keys[t.keys[:, 1] == landmark, 0] for t in (table, whole))
                assert sorted(set(kept)) == sorted({there.min(), there.max()})
    meetings = [(t.robot, *robot_of(t.keys[:, 1]).tolist()) for t in least.tables if t.source == "robots"]
    assert meetings == [(1, 2), (2, 3)]


@pytest.mark.parametrize("poses", POSES)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_both_scenarios_fix_the_map(scenario: str, poses: int) -> None:
    """Every variable has a finite variance relative to the first pose; less is known of it from the minimum."""
    bounds = [cramer_rao(simulate(PaperOptions(scenario, poses, *noise))).per_number for noise in NOISE_LEVELS]
    states = [b.state for b in bounds]
    assert all(s is not None and np.isfinite(s) for s in states) and states == sorted(states)
    if scenario == "minimum":
        better = cramer_rao(simulate(PaperOptions("sufficient", poses))).per_number.state
        assert better is not None and states[0] is not None and better < states[0]


@pytest.mark.parametrize(
    ("scenario", "poses", "state"),
    [("minimum", 4, 0.1505), ("minimum", 12, 0.2644), ("sufficient", 4, 0.1187), ("sufficient", 12, 0.1203)],
)
def test_uncertainty_is_of_the_size_that_the_theory_page_reports(scenario: str, poses: int, state: float) -> None:
    """Bounds of an independent simulation, with another geometry, at the lowest noise: within 10 %."""
    assert cramer_rao(simulate(PaperOptions(scenario, poses))).per_number.state == pytest.approx(state, rel=0.1)


def test_noise_levels_scale_the_same_draws() -> None:
    """The same seed at another level: the same noise, larger."""
    low, high = (simulate(PaperOptions("sufficient", 4, *noise), 2) for noise in (NOISE_LEVELS[0], NOISE_LEVELS[2]))
    assert low.truth is not None
    for a, b in zip(low.tables, high.tables, strict=True):
        assert np.allclose(a.whitened(low.truth), b.whitened(low.truth), atol=1e-9)
