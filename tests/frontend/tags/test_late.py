"""Corners seen late are put where they would have been seen at the keyframe's instant."""

import numpy as np
import pytest

from teamslam.frontend.tags.late import Motion, at_one_instant, erring
from teamslam.frontend.tags.rows import LOOKING, SQUARE
from teamslam.geometry import Pose, s2

LATE_S = np.array([-0.02, -0.015, 0.01, 0.02])  # of the corners
NEAT = np.tile(np.eye(8) / 1e-3, (40, 1, 1))


def scene(rng, fast):
    """Eyes at the origin that see tags some metres ahead; both move with velocities of their own, times `fast`."""
    m = len(NEAT)
    eye, body = (fast * rng.uniform(-1.0, 1.0, (m, 1, 6)) for _ in range(2))
    turn = Pose.from_tangent(np.concatenate([np.zeros((m, 3)), rng.uniform(-0.6, 0.6, (m, 3))], 1), 3)
    facing = LOOKING.inverse().rotation @ np.diag([1.0, -1.0, -1.0])
    place = np.stack([rng.uniform(0.8, 3.0, m), *rng.uniform(-0.5, 0.5, (2, m))], -1)
    there = Pose(turn.rotation @ facing, place)[:, None]
    moved = [Pose.from_tangent(LATE_S[:, None] * v, 3) for v in (eye, body)]
    points = np.tile(0.16 * SQUARE + [0.1, 0.0, 0.05], (m, 1, 1))
    seen = s2.of(moved[0].inverse().act((there @ moved[1]).act(points)))
    at_once = s2.of(there.act(points))
    return seen, points, Motion(*moved), at_once


def test_what_was_seen_late_is_turned_back():
    off = []
    for fast in (0.5, 0.125):
        seen, points, motion, at_once = scene(np.random.default_rng(1), fast)
        found, _ = at_one_instant(seen, points, NEAT, motion)
        shares = np.linalg.norm(found - at_once, axis=(1, 2)) / np.linalg.norm(seen - at_once, axis=(1, 2))
        assert np.median(shares) < 0.01
        off.append(np.median(shares))
    assert off[1] < off[0] / 8.0  # by another power of the motion, and more


def test_what_was_seen_in_time_stays():
    seen, points, _, _ = scene(np.random.default_rng(2), 0.0)
    still = Pose.identity(3, seen.shape[:2])
    np.testing.assert_allclose(at_one_instant(seen, points, NEAT, Motion(still, still))[0], seen, atol=1e-12)


@pytest.mark.parametrize("mover", ["eye", "body"])
def test_noise_stays_as_it_is(mover):
    """A direction that errs is turned with its error, whoever moved."""
    rng = np.random.default_rng(3)
    seen, points, motion, _ = scene(rng, 0.5)
    still = Pose.identity(3, seen.shape[:2])
    motion = Motion(motion.eye, still) if mover == "eye" else Motion(still, motion.body)
    noise = 1e-4 * rng.normal(size=(*seen.shape[:2], 2))
    noisy = s2.plus(seen.reshape(-1, 3), noise.reshape(-1, 2)).reshape(seen.shape)
    one, other = (at_one_instant(rays, points, NEAT, motion)[0] for rays in (seen, noisy))
    length = np.linalg.norm(s2.minus(other, one), axis=-1) / np.linalg.norm(noise, axis=-1)
    assert 0.97 < np.median(length) < 1.03


def test_what_motion_errs_by_is_what_it_does_to_directions():
    """Small motions of the eye and of bodies that are not known of, each corner's as long as it was late."""
    rng = np.random.default_rng(4)
    _, points, _, at_once = scene(rng, 0.0)
    still = Pose.identity(3, at_once.shape[:2])
    _, there = at_one_instant(at_once, points, NEAT, Motion(still, still))
    v = 1e-3 * rng.normal(size=(2, len(NEAT), 6))
    moved = [Pose.from_tangent(LATE_S[:, None] * each[:, None], 3) for each in v]
    seen = s2.of(moved[0].inverse().act((there[:, None] @ moved[1]).act(points)))
    late = np.broadcast_to(LATE_S[:, None, None] * np.eye(6), (*at_once.shape[:2], 6, 6))
    errs = (
        erring(at_once, points, Motion(still, still, late, late), there) @ np.concatenate([v[0], v[1]], -1)[..., None]
    )
    off = -s2.minus(seen.reshape(-1, 3), at_once.reshape(-1, 3)).reshape(len(NEAT), 8)
    np.testing.assert_allclose(errs[..., 0], off, atol=1e-3 * np.abs(off).max())
