"""What any explanation can bring at most, beside every explanation that there is."""

from hypothesis import given
from hypothesis import strategies as st

from teamslam.trust.evidence import Fit, most_to_gain, unlikely

SHARES = st.floats(0.0, 1.0)


@given(st.integers(1, 5000), st.floats(0.0, 20.0), SHARES, SHARES, SHARES)
def test_nothing_explains_more_than_the_bound(dof: int, times: float, cost: float, gone: float, known: float) -> None:
    """However much of the cost goes with whatever share of the numbers, and however few of these are known to go."""
    whole = Fit(times * dof, dof)
    freed = round(gone * dof)
    rest = Fit(cost * whole.cost * (freed < dof), dof - freed)  # what has nothing to spare costs nothing
    gained = unlikely(whole, whole) - unlikely(whole, rest)
    for least in {0, int(known * freed), freed}:
        assert gained <= most_to_gain(whole, least) + 1e-9 * (1.0 + dof)


@given(st.integers(2, 5000), st.floats(1.0, 20.0), SHARES)
def test_the_bound_is_reached_where_the_rest_fits_as_stated(dof: int, times: float, gone: float) -> None:
    whole = Fit(times * dof, dof)
    freed = min(int(gone * dof), dof - 1)
    rest = Fit(float(dof - freed), dof - freed)
    gained = unlikely(whole, whole) - unlikely(whole, rest)
    if freed:
        assert abs(gained - most_to_gain(whole, freed)) <= 1e-9 * (1.0 + dof)


@given(st.integers(1, 5000), st.floats(0.0, 20.0), SHARES)
def test_who_sets_more_free_gains_less(dof: int, times: float, gone: float) -> None:
    whole = Fit(times * dof, dof)
    freed = int(gone * dof)
    assert most_to_gain(whole, freed) <= most_to_gain(whole, max(freed - 1, 0)) + 1e-9 * (1.0 + dof)


@given(st.integers(1, 5000), st.floats(0.0, 1.0))
def test_noise_no_larger_than_stated_leaves_nothing_to_explain(dof: int, times: float) -> None:
    assert most_to_gain(Fit(times * dof, dof)) <= 1e-9 * dof
