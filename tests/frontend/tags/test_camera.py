"""A camera's directions and pixels are each other's inverse, and its formulas those of OpenCV, written out."""

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import s2

CAMERAS = {
    "no distortion": Camera((600.0, 610.0), (320.0, 240.0), size=(640, 480)),
    "radtan 4": Camera((1405.76, 1404.8), (958.0, 607.6), "radtan", (-0.167, 0.11, 8e-5, 7e-5), (1920, 1200)),
    "radtan 5": Camera((1405.76, 1404.8), (958.0, 607.6), "radtan", (-0.167, 0.11, 8e-5, 7e-5, -0.0287), (1920, 1200)),
    "radtan 8": Camera(
        (500.0, 500.0), (320.0, 240.0), "radtan", (0.5, -2.6, 3e-4, -2e-4, 1.5, 0.4, -2.4, 1.4), (640, 480)
    ),
    "equidistant": Camera((283.9, 285.0), (421.1, 400.5), "equidistant", (0.0013, 0.0305, -0.0288, 0.0034), (848, 800)),
}


@pytest.fixture(params=CAMERAS)
def camera(request):
    return CAMERAS[request.param]


def pixels_of(camera, count=400):
    return np.random.default_rng(0).uniform((0, 0), camera.size, (count, 2))


def test_a_pixel_looks_where_it_appears(camera):
    pixels = pixels_of(camera)
    rays, good = camera.rays(pixels)
    assert good.mean() > 0.95
    rays, pixels = rays[good], pixels[good]
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    np.testing.assert_allclose(camera.project(3.7 * rays), pixels, atol=1e-6)


def test_directions_turn_as_their_slopes_say(camera):
    pixels = 0.5 * np.array(camera.size) + 0.8 * (pixels_of(camera, 50) - 0.5 * np.array(camera.size))
    rays, _ = camera.rays(pixels)
    slopes = camera.ray_slopes(pixels)
    move = np.array([0.013, -0.02])
    turned = -s2.minus(rays, camera.rays(pixels + move)[0])
    np.testing.assert_allclose(turned, slopes @ move, rtol=2e-3, atol=1e-9)


def test_radtan_is_opencvs_formula():
    k1, k2, p1, p2, k3, k4, k5, k6 = CAMERAS["radtan 8"].distortion
    X, Y, Z = 0.4, -0.3, 1.25
    a, b = X / Z, Y / Z
    r2 = a * a + b * b
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    x = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a)
    y = b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b
    np.testing.assert_allclose(CAMERAS["radtan 8"].project(np.array([X, Y, Z])), [500 * x + 320, 500 * y + 240])


def test_equidistant_is_opencvs_formula_and_sees_sideways():
    camera = CAMERAS["equidistant"]
    k1, k2, k3, k4 = camera.distortion
    for point in ([0.4, -0.3, 1.25], [2.0, 1.0, 0.1]):
        X, Y, Z = point
        a, b = X / Z, Y / Z
        r = np.hypot(a, b)
        t = np.arctan(r)
        bent = t * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8) / r
        expected = [283.9 * a * bent + 421.1, 285.0 * b * bent + 400.5]
        np.testing.assert_allclose(camera.project(np.array(point)), expected, rtol=1e-12)
    behind, wide = np.array([[1.0, 0.2, -0.5]]), Camera((200.0, 200.0), (400.0, 400.0), "equidistant", (0.01, 0, 0, 0))
    rays, good = wide.rays(wide.project(behind))
    assert good.all() and (np.abs(rays - s2.of(behind)) < 1e-9).all()


def test_beyond_what_a_model_can_say_there_is_no_direction():
    """k1 = -0.5 turns back at r^2 = 2/3: no point appears beyond 0.544 focal lengths from the centre."""
    camera = Camera((100.0, 100.0), (0.0, 0.0), "radtan", (-0.5, 0.0, 0.0, 0.0))
    _, good = camera.rays(np.array([[30.0, 0.0], [50.0, 0.0], [55.0, 0.0], [200.0, 0.0]]))
    assert good.tolist() == [True, True, False, False]
    assert np.isnan(camera.project(np.array([0.1, 0.1, -1.0]))).all()


def test_what_can_be_no_camera_is_refused():
    with pytest.raises(InputError, match="unknown distortion model 'omni'"):
        Camera((1.0, 1.0), (0.0, 0.0), "omni")
    with pytest.raises(InputError, match="equidistant distortion has 0 or 4 numbers, found 5"):
        Camera((1.0, 1.0), (0.0, 0.0), "equidistant", (0.0,) * 5)
    with pytest.raises(InputError, match="above 0"):
        Camera((0.0, 1.0), (0.0, 0.0))
