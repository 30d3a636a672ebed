"""Laws of losses: the weight is the slope of the cost, and each loss is quadratic near zero."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from teamslam.errors import InputError
from teamslam.model import LOSSES, SQUARED, Loss

names = st.sampled_from(sorted(LOSSES))
scales = st.floats(0.05, 20.0)
ROBUST = sorted(set(LOSSES) - {"squared"})


@given(names, scales, st.floats(1e-3, 1e4))
def test_the_weight_is_the_slope_of_the_cost(name: str, scale: float, s: float) -> None:
    loss, step = Loss(name, scale), 1e-5 * s
    slope = (loss.cost(np.array(s + step)) - loss.cost(np.array(s - step))) / (2.0 * step)
    assert_allclose(loss.weight(np.array(s)), slope, rtol=1e-4, atol=1e-9)


@given(names, scales)
def test_every_loss_is_the_square_near_zero(name: str, scale: float) -> None:
    loss, s = Loss(name, scale), 1e-9 * scale**2 * np.array([0.0, 0.5, 1.0])
    assert_allclose(loss.cost(s), s, rtol=1e-8)
    assert_allclose(loss.weight(s), 1.0, rtol=1e-8)


@given(names, scales)
def test_weights_lie_in_zero_to_one_and_fall(name: str, scale: float) -> None:
    s = scale**2 * np.logspace(-6, 6, 200)
    weight = Loss(name, scale).weight(s)
    assert ((weight > 0.0) & (weight <= 1.0)).all()
    assert (np.diff(weight) <= 0.0).all()
    assert (np.diff(Loss(name, scale).cost(s)) >= 0.0).all()


@pytest.mark.parametrize("name", ROBUST)
def test_a_robust_loss_is_nearly_the_square_at_a_large_scale(name: str) -> None:
    s = np.linspace(0.0, 100.0, 50)
    assert_allclose(Loss(name, 1e5).cost(s), s, rtol=1e-6)


def test_the_limits_of_each_robust_loss() -> None:
    """Far out, scale k: Huber is linear in the residual (2k|r| - k^2), Cauchy k^2 log(s/k^2), GM ends at k^2."""
    k, s = 1.5, np.array([1e8, 1e10])
    assert_allclose(Loss("huber", k).cost(s), 2.0 * k * np.sqrt(s) - k * k)
    assert_allclose(Loss("cauchy", k).cost(s), k * k * np.log(s / k**2), rtol=1e-8)
    assert_allclose(Loss("geman_mcclure", k).cost(s), k * k, rtol=1e-7)
    assert_allclose(Loss("huber", k).cost(np.array(k * k)), k * k)


def test_squared_is_the_default() -> None:
    s = np.array([0.0, 1.0, 9.0])
    assert Loss() == SQUARED
    assert_allclose(SQUARED.cost(s), s)
    assert_allclose(SQUARED.weight(s), 1.0)


@given(names, scales)
def test_a_loss_of_nothing_is_nothing(name: str, scale: float) -> None:
    assert Loss(name, scale).cost(np.zeros(0)).shape == Loss(name, scale).weight(np.zeros(0)).shape == (0,)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan")])
def test_a_scale_that_is_not_positive_is_refused(scale: float) -> None:
    with pytest.raises(InputError, match="positive number of sigmas"):
        Loss("huber", scale)


def test_an_unknown_loss_names_those_there_are() -> None:
    with pytest.raises(InputError, match="huber"):
        Loss("hubber")
