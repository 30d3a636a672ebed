"""Films against geometry: tags are found where the camera's formulas put them, at the instant of their line."""

import numpy as np
import pytest

from teamslam.errors import InputError
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.detect import Detector, Looking
from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Pose
from teamslam.sim.film import PRESETS, Options, film
from teamslam.sim.film.boards import PER_SIDE, Board, tag_picture
from teamslam.sim.film.develop import Sensor, develop
from teamslam.sim.film.lens import gathered
from teamslam.sim.film.render import Renderer
from teamslam.sim.film.shutter import FINE, THIRDS, Shutter
from teamslam.sim.film.stage import CAMERA, FACE_TAG_M, TAG_M

MADE = film(PRESETS["ideal"], 4)


def body(robot, t, made=MADE):
    x, y, heading = made.stage.ways[robot].at(np.array(t))
    return Pose.from_tangent(np.array([x, y, 0.0, 0.0, 0.0, heading]), 3)


def projected(robot, t, number, made=MADE):
    """Where the corners of a tag are in an image, by the definitions."""
    eye = (body(robot, t, made) @ CAMERA).inverse()
    if number in made.stage.walls:
        tag, size = made.stage.walls[number], TAG_M
    else:
        other = 1 - robot
        tag, size = body(other, t, made) @ made.stage.cubes[other][number], FACE_TAG_M
    return made.options.camera.project((eye @ tag).act(size * SQUARE))


def seen(robot, t, shutter=None):
    options = MADE.options
    light = Renderer(MADE.stage, options.camera, shutter or options.shutter).image(robot, t)
    return Detector(Looking())(develop(light, options.sensor, t, np.random.default_rng(0)))


def views(wanted, count=2):
    """Instants (robot, t) at which a tag of a kind is well inside the image and large enough."""
    found = []
    for robot in (0, 1):
        for t in np.arange(0.3, 40.0, 0.37).tolist():
            for number in [*MADE.stage.walls, *MADE.stage.cubes[1 - robot]]:
                on_wall = number in MADE.stage.walls
                corners = projected(robot, t, number)
                inside = (corners > 20).all() and (corners < np.array(MADE.options.camera.size) - 20).all()
                edges = np.roll(corners, -1, 0) - corners
                turned = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]  # below 0: its front
                if (wanted == "wall") == on_wall and inside and turned < -1500.0:
                    found.append((robot, t, number))
    assert len(found) >= count
    return found[:: max(len(found) // count, 1)][:count]


@pytest.mark.parametrize("kind", ["wall", "robot"])
def test_tags_are_where_the_camera_puts_them(kind):
    for robot, t, number in views(kind):
        found = seen(robot, t)
        assert number in found.ids.tolist()
        assert np.abs(found.corners[found.ids == number][0] - projected(robot, t, number)).max() < 0.25


def test_a_line_is_seen_when_it_is_exposed():
    """While a robot turns, a rolling shutter moves corners by pixels; each is where it was at its line's instant."""
    turning = [v for v in views("wall", 30) if abs(_turning(v[0], v[1])) > 0.5]
    robot, t, number = turning[len(turning) // 2]
    shutter = Shutter(0.0, 60e-6)
    found = seen(robot, t, shutter)
    corners = found.corners[found.ids == number][0]
    late = (corners[:, 1] - 239.5) * shutter.line_s
    there = np.stack([projected(robot, t + d, number)[k] for k, d in enumerate(late.tolist())])
    assert np.abs(corners - there).max() < 0.3 < 0.6 < np.abs(there - projected(robot, t, number)).max()


def _turning(robot, t):
    ahead, behind = (MADE.stage.ways[robot].at(np.array(t + d))[2] for d in (0.01, -0.01))
    return (ahead - behind) / 0.02


def test_a_moving_edge_is_smeared_about_its_middle():
    for square in (THIRDS, THIRDS.T):
        np.testing.assert_array_equal(np.sort(square, 1), [range(FINE)] * FINE)
    turning = [v for v in views("wall", 30) if abs(_turning(v[0], v[1])) > 0.5]
    robot, t, number = turning[len(turning) // 3]
    sharp, smeared = seen(robot, t), seen(robot, t, Shutter(0.012, 0.0))
    one, other = (f.corners[f.ids == number][0] for f in (sharp, smeared))
    assert np.abs(one - other).mean() < 0.5
    widths = [f.widths[f.ids == number][0] for f in (sharp, smeared)]
    assert widths[1][[1, 3]].min() > 1.5 * widths[0][[1, 3]].max()  # its upright edges


def test_robots_drive_as_they_look_and_keep_apart():
    t = np.arange(0.0, 120.0, 0.05)
    for seed in range(20):
        ways = film(Options(), seed).stage.ways
        tracks = [way.at(t) for way in ways]
        assert np.linalg.norm(tracks[0][:, :2] - tracks[1][:, :2], axis=1).min() > 0.5
        for track in tracks:
            heading = np.unwrap(track[:, 2])
            step, middle = np.diff(track[:, :2], axis=0), 0.5 * (heading[1:] + heading[:-1])
            length = np.linalg.norm(step, axis=1)
            ahead = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
            assert (ahead[length > 1e-4] > 0.98 * length[length > 1e-4]).all()
            assert np.abs(track[:, :2]).max() < 2.2


def test_the_same_seed_is_the_same_film():
    short = Options(seconds=1.0, images_hz=1.0)
    one, again, other = (next(film(short, seed).frames(0)).image for seed in (3, 3, 4))
    assert np.array_equal(one, again) and not np.array_equal(one, other)
    a, b = film(short, 3).odometry(0), film(short, 3).odometry(0)
    assert np.array_equal(a.poses.translation, b.poses.translation)


def test_grey_values_err_as_the_sensor_says():
    flat = np.full((600, 600), 0.4)
    sensor = Sensor(blur_px=0.0, vignetting=0.0, brightness=1.0, breathing=0.0, read=2.0, shot=0.1)
    image = develop(flat, sensor, 0.0, np.random.default_rng(0)).astype(float)
    assert abs(image.mean() - 102.0) < 0.1
    assert abs(image.std() - np.sqrt(4.0 + 10.2 + 1.0 / 12.0)) < 0.1


@pytest.mark.parametrize("wrong", [{"seconds": 0.0}, {"images_hz": 1e4}, {"seconds": float("nan")}])
def test_films_that_cannot_be_made_are_refused(wrong):
    with pytest.raises(InputError):
        Options(**wrong)


def test_tags_that_are_not_there_are_refused():
    assert tag_picture(0).shape == (PER_SIDE + 2,) * 2
    with pytest.raises(InputError, match="tags 0 to 586"):
        tag_picture(587)


@pytest.mark.parametrize("blur", [0.0, 0.5])
@pytest.mark.parametrize("smear", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("upright", [True, False])
def test_an_edge_along_the_lines_of_the_image_is_where_it_is(upright, smear, blur):
    """A board that faces the camera, dark on one side and light on the other, moving across the edge: the light on the
    pixels says where the edge is, wherever between two pixels that is."""
    camera = Camera((100.0, 100.0), (31.5, 23.5), size=(64, 48))
    renderer = Renderer(MADE.stage, camera, Shutter(0.01, 0.0))
    across = np.array([1.0, 0.0, 0.0] if upright else [0.0, 1.0, 0.0])
    within = ((np.arange(FINE) - 1.0) / FINE)[:, None] * np.ones(camera.size[1])
    eye = Pose(np.broadcast_to(np.eye(3), (*within.shape, 3, 3)), np.zeros((*within.shape, 3)))
    facing = np.diag([1.0, -1.0, -1.0])
    for off in np.linspace(-0.5, 0.5, 7):
        place = (off + smear * within)[..., None] / 100.0 * across + [0.0, 0.0, 1.0]
        board = Board(Pose(facing, np.zeros(3)), (2.0, 2.0), np.array([[1.0, 0.0]] if upright else [[1.0], [0.0]]))
        points = renderer.scene(eye, [(board, Pose(np.broadcast_to(np.eye(3), (*within.shape, 3, 3)), place))])
        light = gathered(points, blur)
        row = (light[10:34, 8:56] if upright else light[8:40, 8:56].T).mean(0)
        middle = camera.centre[0 if upright else 1] + off
        assert row.sum() + 7.5 == pytest.approx(middle, abs=1e-3)
        slope = (row[:-2] - row[2:]) ** 2  # and so do its squared slopes, by which the library of tags finds edges
        assert 9.0 + slope @ np.arange(len(slope)) / slope.sum() == pytest.approx(middle, abs=0.01 if blur else 0.17)
