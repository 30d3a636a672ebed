"""What losses cost under a right model, against integrals by another library and against draws."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from teamslam.model import LOSSES, Loss
from teamslam.trust.expected import expected_cost

SCALES = (0.5, 1.0, 2.0, 5.0)
EVERY = [Loss(name, scale) for name in LOSSES for scale in SCALES]


@pytest.mark.parametrize("rows", [1, 2, 3, 6])
@pytest.mark.parametrize("loss", EVERY, ids=str)
def test_mean_and_variance_are_the_integrals_over_chi_square(loss: Loss, rows: int) -> None:
    def mean(of) -> float:
        pieces = ((0.0, loss.scale**2), (loss.scale**2, np.inf))
        return sum(
            quad(lambda s: of(np.array([s]))[0] * chi2.pdf(s, rows), *ends, epsabs=1e-12, limit=200)[0]
            for ends in pieces
        )

    found = expected_cost(loss, rows)
    assert found.mean == pytest.approx(mean(loss.cost), rel=1e-6)
    assert found.variance == pytest.approx(mean(lambda s: (loss.cost(s) - found.mean) ** 2), rel=1e-6)


@pytest.mark.parametrize("rows", [1, 2, 3, 6])
def test_the_squared_loss_is_chi_square_itself(rows: int) -> None:
    found = expected_cost(Loss(), rows)
    assert (found.mean, found.variance, found.given_way) == pytest.approx((rows, 2 * rows, 1.0), rel=1e-12)


@pytest.mark.parametrize("loss", [Loss("huber", 1.0), Loss("cauchy", 2.0), Loss("geman_mcclure", 3.0)], ids=str)
def test_an_unknown_takes_away_what_is_said(loss: Loss) -> None:
    """The mean of m planar points under a loss: two unknowns, found by reweighting. The drop of the cost from the
    truth to the optimum, over many draws, is twice `given_way`."""
    rng, m, draws = np.random.default_rng(5), 60, 3000
    u = rng.standard_normal((draws, m, 2))
    at = np.zeros((draws, 1, 2))
    for _ in range(60):
        w = loss.weight(np.sum((u - at) ** 2, -1))[..., None]
        at = np.sum(w * u, 1, keepdims=True) / np.sum(w, 1, keepdims=True)
    drop = loss.cost(np.sum(u**2, -1)).sum(-1) - loss.cost(np.sum((u - at) ** 2, -1)).sum(-1)
    spread = drop.std() / np.sqrt(draws)
    expected = 2.0 * expected_cost(loss, 2).given_way
    assert abs(drop.mean() - expected) < 4.0 * spread + 0.05 * expected
