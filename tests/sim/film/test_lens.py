"""Light through a lens, against the convolution of a Gaussian with the square of a pixel."""

import numpy as np
import pytest
from scipy.special import ndtr

from teamslam.sim.film.lens import gathered
from teamslam.sim.film.shutter import FINE


@pytest.mark.parametrize("blur", [0.0, 0.4, 1.5])
def test_a_spot_is_spread_as_the_lens_and_the_pixels_have_it(blur):
    points = np.zeros((FINE * 21, FINE * 25))
    points[FINE * 10 + 1, FINE * 12 + 2] = FINE**2  # a third of a pixel right of the middle of pixel (10, 12)
    light = gathered(points, blur)

    def shares(count, middle):
        spots = middle + (np.arange(9) - 4.0) / (9.0 * FINE)  # of the square that the point stands for
        ends = [(np.arange(count)[:, None] + half - spots) for half in (0.5, -0.5)]
        one, other = (ndtr(e / blur) if blur else (e > 0.0) for e in ends)
        return (1.0 * one - other).mean(1)

    np.testing.assert_allclose(light, np.outer(shares(21, 10.0), shares(25, 12.0 + 1.0 / FINE)), atol=2e-4)
    assert light.sum() == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("blur", [0.0, 0.5, 2.0])
def test_an_even_image_stays_so_to_its_border(blur):
    np.testing.assert_allclose(gathered(np.full((FINE * 8, FINE * 9), 0.4), blur), 0.4, rtol=1e-5)
