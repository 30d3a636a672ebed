"""Corners where lenses bend edges: what straight lines make of them goes out again."""

import numpy as np
import pytest

from teamslam.frontend.tags.bent import unbent
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Pose

LENSES = {
    "barrel": Camera((500.0, 500.0), (320.0, 240.0), "radtan", (-0.3, 0.1, 0.001, -0.0005), (640, 480)),
    "mild": Camera((525.0, 525.0), (319.5, 239.5), "radtan", (0.05, -0.11, 0.0008, -0.0005, 0.02), (640, 480)),
    "fisheye": Camera((280.0, 280.0), (320.0, 240.0), "equidistant", (0.01, -0.002, 0.0, 0.0), (640, 480)),
}


def seen(camera, seed, count=60):
    """Tags before a camera, wholly in the image: where their corners are, and where lines cross that are fitted to
    points of their edges, as the AprilTag library takes them: evenly along the chord, each where the edge is there."""
    rng, true, found = np.random.default_rng(seed), [], []
    while len(true) < count:
        place = rng.uniform(-1.0, 1.0, 3) * np.array([0.7, 0.5, 0.4]) + np.array([0.0, 0.0, 0.9])
        turn = rng.uniform(-0.8, 0.8, 3) + np.array([np.pi, 0.0, 0.0])
        leaned = Pose.from_tangent(np.concatenate([place, turn]), 3)
        places = leaned.act(0.16 * SQUARE)
        pixels = camera.project(places)
        if not (np.isfinite(pixels).all() and (pixels > 5).all() and (pixels < np.array(camera.size) - 5).all()):
            continue
        lines = [_line(camera, places[k], places[(k + 1) % 4]) for k in range(4)]
        true.append(pixels)
        found.append([_meet(lines[k - 1], lines[k]) for k in range(4)])
    return np.array(true), np.array(found)


def _line(camera, start, end):
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    edge = camera.project((1.0 - share) * start + share * end)
    along = (edge[-1] - edge[0]) / np.linalg.norm(edge[-1] - edge[0])
    normal = np.array([-along[1], along[0]])
    u, h = (edge - edge[0]) @ along, (edge - edge[0]) @ normal
    count = max(16, int(u[-1] / 8.0))
    at = u[-1] * (np.arange(count) + 1.0) / (count + 1.0)
    points = edge[0] + at[:, None] * along + np.interp(at, u, h)[:, None] * normal
    middle = points.mean(0)
    return middle, np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 1]


def _meet(one, other):
    share = np.linalg.solve(np.stack([one[1], -other[1]], -1), other[0] - one[0])
    return one[0] + share[0] * one[1]


@pytest.mark.parametrize("lens", LENSES)
def test_what_lines_make_of_bent_edges_goes_out_again(lens):
    true, found = seen(LENSES[lens], 3)
    off, left = (np.linalg.norm(corners - true, axis=-1) for corners in (found, unbent(found, LENSES[lens])))
    assert off.max() > 0.1  # pixels: more than corners are known to
    assert (left < 0.05 * off + 2e-3).all()


def test_without_distortion_nothing_moves():
    camera = Camera((525.0, 525.0), (319.5, 239.5), size=(640, 480))
    true, found = seen(camera, 4)
    np.testing.assert_allclose(found, true, atol=1e-6)
    np.testing.assert_allclose(unbent(true, camera), true, atol=1e-9)


def test_beyond_what_a_lens_can_say_corners_stay():
    camera = LENSES["barrel"]
    far = np.array([[[-3000.0, -3000.0], [4000.0, -3000.0], [4000.0, 4000.0], [-3000.0, 4000.0]]])
    np.testing.assert_array_equal(unbent(far, camera), far)
    assert unbent(np.zeros((0, 4, 2)), camera).shape == (0, 4, 2)
