"""Films of depth against geometry: pixels are as far off as the surfaces that they show, and err as the sensor says."""

import numpy as np
import pytest

from sim.film.test_film import MADE, body, projected, views
from teamslam.sim.film import PRESETS, film
from teamslam.sim.film.ranging import FAR_M, NEAR_M, Ranger, ranged
from teamslam.sim.film.render import Renderer
from teamslam.sim.film.stage import CAMERA, HEIGHT_M, SIDE_M


@pytest.mark.parametrize("kind", ["wall", "robot"])
def test_a_tag_is_as_deep_as_it_is_far(kind):
    renderer = Renderer(MADE.stage, MADE.options.camera, MADE.options.shutter)
    for robot, t, number in views(kind):
        eye = (body(robot, t) @ CAMERA).inverse()
        walls, other = MADE.stage.walls, 1 - robot
        tag = walls[number] if number in walls else body(other, t) @ MADE.stage.cubes[other][number]
        u, v = np.round(projected(robot, t, number).mean(0)).astype(int)
        assert abs(renderer.depth(robot, t)[v, u] - (eye @ tag).translation[2]) < 0.02


def test_every_pixel_shows_a_surface_of_the_room():
    depth = Renderer(MADE.stage, MADE.options.camera, MADE.options.shutter).depth(0, 3.0)
    assert depth.shape == MADE.options.camera.size[::-1]
    assert (depth > 0.05).all() and (depth < np.sqrt(2.0 * SIDE_M**2 + HEIGHT_M**2)).all()


@pytest.mark.parametrize("away", [0.8, 3.0])
def test_depths_err_as_the_sensor_says(away):
    sensor = Ranger(lost=0.0)
    found = 1e-3 * ranged(np.full((300, 300), away), sensor, np.random.default_rng(0)).astype(float)
    assert abs(found.mean() - away) < 3e-4 and 0.95 < found.std() / sensor.sigma(away) < 1.05
    off = found - found.mean()
    alike = np.mean(off[:, 1:] * off[:, :-1]) / np.mean(off**2)
    assert abs(alike - np.exp(-1.0 / (4.0 * sensor.window_px**2))) < 0.05  # of noise that a Gaussian went over


def test_there_are_holes_where_nothing_can_be_measured():
    depth = np.full((100, 100), 2.0)
    depth[:, 50:], depth[:20], depth[80:] = 3.0, 0.9 * NEAR_M, 1.1 * FAR_M
    found = ranged(depth, Ranger(lost=0.02), np.random.default_rng(0))
    assert not found[:20].any() and not found[80:].any() and not found[:, 49:51].any()
    flat = found[25:75, 5:40]
    assert flat.dtype == np.uint16 and 0.005 < np.mean(flat == 0) < 0.04


def test_images_are_as_they_were_and_depths_come_again():
    short = film(PRESETS["experiment"], 3)
    one, again = (next(short.frames(0)) for _ in range(2))
    assert np.array_equal(one.depth, again.depth) and one.depth.shape == one.image.shape
