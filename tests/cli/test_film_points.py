"""What team files of films state of points of edges is what the sensor's noise makes of them, by the rule of the
AprilTag library (written here from its description): centres of squared grey slopes within two pixels of a line."""

import numpy as np
from scipy.special import ndtr

from teamslam.cli.film import EDGE_PX
from teamslam.frontend.tags.edges import NARROWEST, SHARP
from teamslam.frontend.tags.noise import FIRST, SHARED_PX, STEPS, WHOLE, WITHIN, corner_covariances
from teamslam.sim.film.boards import BLACK, WHITE
from teamslam.sim.film.develop import FULL, Sensor

SIZE = 17
GRID = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2.0


def edge(off, angle, blur):
    """Grey values (h, w) about an edge `off` from the middle whose normal has an angle, dark before it."""
    sensor, light = Sensor(), 0.0
    spots = (np.arange(5) + 0.5) / 5.0 - 0.5
    for dy in spots:
        for dx in spots:
            light = light + ndtr(((GRID[1] + dx) * np.cos(angle) + (GRID[0] + dy) * np.sin(angle) - off) / blur) / 25.0
    return FULL * sensor.brightness * (BLACK + (WHITE - BLACK) * light)


def noisy(image, rng):
    sensor = Sensor()
    return np.round(image + np.sqrt(sensor.read**2 + sensor.shot * image) * rng.normal(size=image.shape))


def grey(image, x, y):
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    u, v = x - j, y - i
    upper, lower = ((1 - u) * image[k, j] + u * image[k, j + 1] for k in (i, i + 1))
    return (1 - v) * upper + v * lower


def point(image, angle, at, along=0.0):
    """Where a point of the edge is found that is sought about `at`, so far along the edge."""
    s = np.arange(-WITHIN, WITHIN + 0.01, 0.25)
    x, y = ((SIZE - 1) / 2.0 + t for t in (at * np.cos(angle) - along * np.sin(angle),
                                           at * np.sin(angle) + along * np.cos(angle)))  # fmt: skip
    g = [grey(image, x + (s + d) * np.cos(angle), y + (s + d) * np.sin(angle)) for d in (1.0, -1.0)]
    weight = np.maximum(g[0] - g[1], 0.0) ** 2
    return at + weight @ s / weight.sum()


def test_a_point_errs_by_the_noise_of_grey_values():
    rng = np.random.default_rng(0)
    for blur in (0.5, 1.0, 2.0):
        errors = []
        for _ in range(700):
            off, angle = rng.uniform(-0.5, 0.5), rng.uniform(0.0, 2.0 * np.pi)
            clean = edge(off, angle, blur)
            errors.append(point(noisy(clean, rng), angle, off) - point(clean, angle, off))
        stated = EDGE_PX * max(np.hypot(blur, NARROWEST) / SHARP, 1.0)
        assert 0.85 < np.std(errors) / stated < 1.1  # 700 of them have their deviation to 0.03


def test_points_side_by_side_err_alike():
    rng, lags, errors = np.random.default_rng(1), np.linspace(-1.5, 1.5, 7), []
    for _ in range(500):
        off, angle = rng.uniform(-0.5, 0.5), rng.uniform(0.0, 2.0 * np.pi)
        clean = edge(off, angle, 0.6)
        rough = noisy(clean, rng)
        errors.append([point(rough, angle, off, d) - point(clean, angle, off, d) for d in lags])
    alike = np.corrcoef(np.array(errors).T)[0]
    assert abs(2.0 * np.trapezoid(alike, lags) - SHARED_PX) < 0.4


def test_wide_edges_keep_what_the_first_look_erred_by():
    square = 200.0 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    turned = square @ np.array([[np.cos(0.05), np.sin(0.05)], [-np.sin(0.05), np.cos(0.05)]])
    firsts = WHOLE, np.hypot(FIRST, STEPS / (200.0 * np.sin(0.05)))
    for blur in (0.5, 1.2, 2.5):
        kept = [(point(edge(0.1, a, blur), a, 0.4) - point(edge(0.1, a, blur), a, 0.1)) / 0.3 for a in (0.2, 0.9, 1.4)]
        width = np.full((1, 4), np.hypot(blur, NARROWEST))
        for corners, first in zip((square, turned), firsts, strict=True):
            more = corner_covariances(corners[None], 0.0, 1e-9, width)[0]
            assert abs(np.sqrt(more.diagonal().mean()) / first - np.mean(kept)) < 0.06
