"""What patches of a picture show, against the mean of many spots in them."""

import numpy as np
import pytest

from teamslam.sim.film.patches import light_of


@pytest.mark.parametrize("size", [0.2, 0.9, 3.5])
def test_a_patch_shows_the_mean_of_its_spots(size):
    rng = np.random.default_rng(0)
    picture = rng.uniform(0.0, 1.0, (5, 7))
    x, y = rng.uniform([-1.0, -1.0], [8.0, 6.0], (60, 2)).T
    wide, high = size * rng.uniform(0.5, 1.0, (2, 60))
    light, share = light_of(picture, x, y, wide, high)
    n = 400
    spots = (np.arange(n) + 0.5) / n - 0.5
    columns, rows = (np.floor(middle[:, None] + width[:, None] * spots) for middle, width in ((x, wide), (y, high)))
    framed = np.zeros((5 + 20, 7 + 20))
    framed[10:15, 10:17] = picture
    seen = framed[rows.astype(int)[:, :, None] + 10, columns.astype(int)[:, None] + 10]
    np.testing.assert_allclose(light, seen.mean((1, 2)), atol=0.01)
    framed[10:15, 10:17] = 1.0
    inside = framed[rows.astype(int)[:, :, None] + 10, columns.astype(int)[:, None] + 10]
    np.testing.assert_allclose(share, inside.mean((1, 2)), atol=0.01)


def test_what_is_of_one_grey_shows_it():
    x, y, wide = np.full((3, 4), 1.5), np.full((3, 4), 1.2), np.full((3, 4), 0.8)
    for picture in (np.full((1, 1), 0.3), np.full((3, 3), 0.3)):
        at = (x, y) if len(picture) == 3 else (x / 3.0, y / 3.0)
        light, share = light_of(picture, *at, wide / 3.0, wide / 3.0)
        np.testing.assert_allclose(light, 0.3 * share, rtol=1e-6)
        np.testing.assert_allclose(share, 1.0, rtol=1e-6)
