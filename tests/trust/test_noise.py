"""Outliers are told where chance does not make as many, and only there."""

import pytest
from scipy.stats import binom

from teamslam.pipeline import run
from teamslam.trust.noise import BY_CHANCE, IN_THE_TAIL, Noise
from worlds import team


def told(rows: int, beyond: int) -> bool:
    """Of a part of a sensor, so many of whose rows are beyond what one in a thousand is."""
    return Noise(1, "odometry", "theta", rows, 1.0, max(beyond / rows - IN_THE_TAIL, 0.0)).has_outliers


@pytest.mark.parametrize("rows", [30, 31, 59, 100, 400, 3000, 50_000])
def test_chance_is_not_told_as_outliers(rows: int) -> None:
    """The binomial tail of the least count that is told is below the stated chance; a row less is not far from it."""
    least = next(k for k in range(rows + 1) if told(rows, k))
    assert binom.sf(least - 1, rows, IN_THE_TAIL) < BY_CHANCE
    assert binom.sf(least - 3, rows, IN_THE_TAIL) > BY_CHANCE or (least - 1) / rows <= 0.021


@pytest.mark.parametrize("rows", [30, 59, 400])
def test_what_is_wild_is_told(rows: int) -> None:
    """A fifth of the rows, and all of them."""
    assert told(rows, rows // 5) and told(rows, rows) and not told(rows, 0)


@pytest.mark.parametrize("space", ["2d", "planar", "3d"])
def test_honest_noise_of_short_logs_has_no_outliers(space: str) -> None:
    """Thirty to sixty rows a part, a hundred parts and more: where a share alone decides, half of such runs say so."""
    for seed in range(6):
        result = run(team(space, robots=3, poses=40, seed=seed))
        assert not [n for n in result.verdict.noise if n.has_outliers], seed
