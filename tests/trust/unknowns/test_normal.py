"""What is known of numbers beside their prior, where rounding ate what rows say of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.trust.unknowns.normal import beside_prior


@given(st.integers(0, 10_000), st.integers(1, 6), st.floats(-3.0, 3.0))
def test_it_is_the_inverse_where_rounding_says_nothing(seed: int, k: int, grade: float) -> None:
    rng = np.random.default_rng(seed)
    units, prior = 10.0 ** rng.uniform(-abs(grade), abs(grade), k), 10.0 ** rng.uniform(-2.0, 2.0, k)
    J = rng.normal(size=(k + 2, k)) / units
    information = J.T @ J + np.diag(prior**-2.0)
    known = beside_prior(information, prior)
    sigmas = np.sqrt(np.diag(known))
    np.testing.assert_allclose(known @ information, np.eye(k), atol=1e-6 * np.max(np.outer(sigmas, 1.0 / sigmas)))
    assert (sigmas <= prior * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("less", [0.0, 1e-2, 1.0, 1e4])
def test_a_direction_that_rounding_made_less_than_nothing_is_known_by_the_prior(less: float) -> None:
    """Two numbers of which rows tell the sum alone, to 1e-9: their difference is what rounding left."""
    prior = np.array([2.0, 2.0])
    information = 1e18 * np.ones((2, 2)) - less * np.array([[1.0, -1.0], [-1.0, 1.0]]) + np.diag(prior**-2.0)
    known = beside_prior(information, prior)
    assert (np.linalg.eigvalsh(known) >= 0.0).all() and (np.diag(known) > 0.0).all()
    assert np.sqrt(known[0, 0] + known[1, 1] - 2.0 * known[0, 1]) == pytest.approx(np.sqrt(8.0), rel=0.5)
    assert (np.sqrt(np.diag(known)) <= prior * (1.0 + 1e-12)).all()
