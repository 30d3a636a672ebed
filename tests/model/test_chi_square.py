"""Quantiles of chi-square, against scipy.stats."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from teamslam.model import chi2_quantile


@given(st.floats(1e-6, 1.0 - 1e-6), st.integers(1, 10**6))
def test_it_is_the_quantile(share: float, dof: int) -> None:
    assert np.isclose(chi2_quantile(share, dof), stats.chi2.ppf(share, dof), rtol=1e-9)


@given(st.floats(1e-4, 1.0 - 1e-4), st.lists(st.integers(1, 1000), max_size=5))
def test_many_at_once_are_each_by_itself(share: float, dofs: list[int]) -> None:
    assert chi2_quantile(share, np.array(dofs, int)).tolist() == [chi2_quantile(share, dof) for dof in dofs]
