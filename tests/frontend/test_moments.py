"""How a robot moved in a moment, and how late a camera is by it: neither noise nor where messages are drags that."""

import numpy as np
import pytest

from driven_circle import circle, off_from
from teamslam.frontend.moments import LONGEST_S, Velocities, moved
from teamslam.frontend.streams import Track
from teamslam.frontend.way_noise import WayNoise
from teamslam.geometry import Pose
from thinned import thinned

NOISE = WayNoise(fastest_m_s=50.0, fastest_rad_s=50.0)


def test_the_motion_of_a_moment_is_that_of_the_way():
    track, ticks, over_s = circle(), np.array([1_000_000, 7_777_777]), np.array([[-0.02, 0.0, 0.03], [0.01, 0.02, 0.0]])
    found = moved(track, ticks, over_s, NOISE)
    turn, lift = found.minus(Pose.identity(3, over_s.shape))[..., 5], found.translation[..., 2]
    np.testing.assert_allclose(turn, 0.2 * over_s, atol=1e-6)
    np.testing.assert_allclose(lift, 0.1 * over_s, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found.translation[..., :2], axis=-1), np.abs(over_s), rtol=1e-3)


def test_a_jump_is_no_motion_and_where_odometry_is_missing_nothing_moves():
    track, ticks = circle(), np.array([5_000_000, 9_990_000, 10_000_000, 15_000_000])
    noise = WayNoise(fastest_m_s=2.0)
    whole, jumped = (moved(t, ticks, np.full((4, 1), 0.02), noise) for t in (track, off_from(track, 200, [3, 0, 0])))
    np.testing.assert_allclose(jumped.translation, whole.translation, atol=2e-5)
    gap = track.select((track.ticks < 9_000_000) | (track.ticks > 9_100_000 + 1e6 * LONGEST_S))
    ticks = np.array([5_000_000, 9_500_000, 12_000_000, 60_000_000, -1_000_000])
    found = moved(gap, ticks, np.full((5, 1), 0.02), noise)
    still = np.linalg.norm(found.translation[:, 0], axis=-1) == 0.0
    assert still.tolist() == [False, True, False, True, True]
    assert moved(track.select(slice(0, 1)), np.array([0]), np.ones((1, 4)), noise).batch == (1, 4)


@pytest.mark.parametrize("rate", [8.0, 50.0, 200.0])
def test_the_noisier_odometry_is_the_more_steps_are_averaged(rate):
    """A robot that sways slowly, with wheels that slip more and more: what is told of its velocity errs by far less
    than what two messages beside each other tell, and where there is no noise it follows."""
    t, rng = np.arange(0.0, 60.0, 1.0 / rate), np.random.default_rng(1)
    shown = np.cos(0.9 * t)
    widths, errors = [], []
    for slip in (0.0, 0.01, 0.05):
        x = np.sin(0.9 * t) / 0.9 + np.cumsum(slip / np.sqrt(rate) * rng.normal(size=len(t)))
        found = Velocities.of(along(t, x), NOISE)
        widths.append(found.widths[0])
        errors.append(np.sqrt(np.mean((found.at(found.ticks)[:, 0] - shown) ** 2)))
    assert widths == sorted(widths) and widths[0] < widths[-1]
    assert errors[0] < 0.02
    for error, slip in zip(errors[1:], (0.01, 0.05), strict=True):
        assert error < 0.3 * slip * np.sqrt(max(rate, 20.0)) + 0.01


def along(t, x):
    """Odometry of a robot that moves along x."""
    return Track(np.round(t * 1e6).astype(np.int64), Pose(np.tile(np.eye(3), (len(t), 1, 1)), x[:, None] * [1, 0, 0]))


def lateness(seed, rate, phase, kind, sway, every_s=0.25, late_s=0.0):
    """How late a camera is and its sigma, by all of least squares in one dimension: a robot drives along x, in images
    `phase` of a message after messages it sees where it is to 3 mm, and between images its odometry counts. Noise is
    that of steps ('steps'), or each message's own ('messages')."""
    rng, n, seen = np.random.default_rng(seed), 120, 0.003
    t = np.arange(-3.0, n * every_s + 3.0, 1.0 / rate)
    first, second = rng.uniform(0.0, 2.0 * np.pi, 2)

    def x(t):
        return 0.9 * t + sway * (np.sin(0.9 * t + first) + 0.2 * np.sin(2.6 * t + second))

    taken = np.arange(n) * every_s + phase / rate
    noise = rng.normal(size=len(t))
    slip = 0.02
    off = np.cumsum(slip / np.sqrt(rate) * noise) if kind == "steps" else 0.005 * noise
    variance = slip**2 * every_s if kind == "steps" else 2.0 * 0.005**2
    z, track = x(taken) + seen * rng.normal(size=n), along(t, x(t) + off)
    velocities = Velocities.of(track, NOISE)
    steps = (np.eye(n)[1:] - np.eye(n)[:-1]) / np.sqrt(variance)
    A = np.concatenate([steps, np.eye(n) / seen])
    inverse, delay = np.linalg.inv(A.T @ A), 0.0
    for _ in range(10):
        at = taken + late_s - delay
        b = np.concatenate([np.diff(np.interp(at, t, x(t) + off)) / np.sqrt(variance), z / seen])
        error = A @ (inverse @ (A.T @ b)) - b
        D = np.append(np.zeros(n - 1), velocities.at(np.round(at * 1e6).astype(np.int64))[:, 0] / seen)
        D = D - A @ (inverse @ (A.T @ D))
        step = D @ error / (D @ D)
        delay += np.clip(step, -0.2, 0.2)
        if abs(step) < 0.1 / np.sqrt(D @ D):
            break
    return delay - late_s, 1.0 / np.sqrt(D @ D)


@pytest.mark.parametrize(
    ("rate", "kind", "images"),
    thinned(4, [8.0, 100.0], ["steps", "messages"], [(0.0, 0.0), (0.3, 0.0), (0.0, 0.03), (0.5, 0.12)]),
)
def test_how_late_a_camera_is_is_told_without_bias_and_within_its_sigma(rate, kind, images):
    """A robot that sways little tells it badly, and must say so. Velocities from two messages told it as up to six
    times better known than it was, and 25 ms off where images stood so to messages."""
    (phase, late_s), count = images, 40
    for sway in (0.05, 0.3):
        off, sigma = np.array([lateness([k, 7], rate, phase, kind, sway, late_s=late_s) for k in range(count)]).T
        assert abs(off.mean()) < 4.0 * off.std() / np.sqrt(count) + 1e-3
        z = np.mean((off / sigma) ** 2)
        assert z < 1.0 + 4.0 * np.sqrt(2.0 / count)  # noise of each message is stated as that of steps, which is more
        assert z > 0.3 or kind == "messages"
