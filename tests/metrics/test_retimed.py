"""How late a truth is, by positions alone."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from teamslam.geometry import so2
from teamslam.metrics import late_truth

TRUE_S = np.arange(-2.0, 42.0, 0.02)


def way(t):
    return np.stack([2.0 * np.cos(0.5 * t) + 0.3 * np.sin(2.1 * t), 1.5 * np.sin(0.5 * t)], -1)


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.9, 0.9), st.floats(-3.0, 3.0), st.integers(0, 2**31))
def test_what_was_planted_is_found_within_its_sigma(late, turn, seed):
    rng = np.random.default_rng(seed)
    at = np.arange(0.0, 40.0, 0.4)
    mapped = way(at) @ so2.exp(np.array([turn])).T + [3.0, -1.0] + 0.003 * rng.normal(size=(len(at), 2))
    found = late_truth(at, mapped, TRUE_S + late, way(TRUE_S))
    assert found is not None
    assert found.sigma_s < 0.002 and abs(found.value_s - late) < 5.0 * found.sigma_s + 1e-4


def test_who_stands_tells_nothing_of_time():
    at = np.arange(0.0, 40.0, 0.4)
    assert late_truth(at, np.zeros((len(at), 2)), TRUE_S, np.zeros((len(TRUE_S), 2))) is None
    assert late_truth(at[:3], way(at[:3]), TRUE_S, way(TRUE_S)) is None
