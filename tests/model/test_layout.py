"""Layouts: where keys stand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from teamslam.model import Kind, Layout, among
from teamslam.model.layout import distinct

KEYS = st.integers(-(2**62), 2**62) | st.integers(0, 6)


@given(hnp.arrays(np.int64, hnp.array_shapes(min_dims=1, max_dims=2, min_side=0), elements=KEYS), st.sets(KEYS))
def test_among_says_what_isin_says(keys: np.ndarray, known: set[int]) -> None:
    rising = np.array(sorted(known), np.int64)
    found = among(keys, rising)
    assert found.shape == keys.shape
    np.testing.assert_array_equal(found, np.isin(keys, rising))


@given(hnp.arrays(np.int64, hnp.array_shapes(min_dims=1, max_dims=2, min_side=0), elements=KEYS), st.booleans())
def test_distinct_keys_are_those_of_unique(keys: np.ndarray, rising: bool) -> None:
    keys = np.sort(keys, axis=None) if rising else keys
    found = distinct(keys)
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, np.unique(keys))


@given(st.sets(KEYS), st.lists(KEYS))
def test_a_layout_contains_its_keys_alone(known: set[int], asked: list[int]) -> None:
    rng = np.random.default_rng(len(known))
    layout = Layout.of(np.array(sorted(known), np.int64), rng.choice([Kind.POSE2, Kind.POINT2], len(known)))
    assert layout.contains(np.array(asked, np.int64)).tolist() == [key in known for key in asked]
    assert all(layout.contains(key) for key in known)
