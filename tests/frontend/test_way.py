"""Odometry between keyframes: what it says, where it does not jump; and what is known where it says nothing."""

import numpy as np
import pytest

from driven_circle import circle, off_from
from teamslam.frontend.interpolate import interpolate
from teamslam.frontend.streams import Track
from teamslam.frontend.way import beside_the_line, standing, steps_between
from teamslam.frontend.way_noise import WayNoise, jumps
from teamslam.geometry import Pose, compose_along, so3

NOISE = WayNoise(speed_m_s=0.8, turn_rad_s=0.5, fastest_m_s=2.0)


def test_steps_are_those_of_the_way_wherever_it_starts():
    track, keyframes = circle(), np.array([130_000, 1_000_000, 7_777_777, 19_000_000])
    there = Pose.from_tangent(np.array([3.0, -2.0, 1.0, 0.3, 0.2, 2.0]), 3)
    for seen in (track, Track(track.ticks, there[None] @ track.poses)):
        steps = steps_between(seen, keyframes, NOISE)
        assert not len(steps.jumps) and not steps.missing
        turned = steps.poses.minus(Pose.identity(3, (3,)))[:, 5]
        np.testing.assert_allclose(turned, 0.2e-6 * np.diff(keyframes), atol=1e-9)
        chord = 10 * np.sin(0.1e-6 * np.diff(keyframes))
        np.testing.assert_allclose(np.linalg.norm(steps.poses.translation[:, :2], axis=1), chord, rtol=2e-3)


def test_a_jump_is_found_and_only_its_own_step_is_lost():
    keyframes = np.arange(0, 19_000_001, 500_000)
    whole = steps_between(circle(), keyframes, NOISE)
    broken = steps_between(off_from(circle(), 203, [0.25, 0.0, 0.0]), keyframes, NOISE)
    assert broken.jumps.tolist() == [10_150_000]
    lost = np.flatnonzero(np.abs(broken.poses.minus(whole.poses)).max(1) > 1e-9)
    assert lost.tolist() == [20]
    model, spread = standing(np.array([0.5]), NOISE)
    np.testing.assert_allclose(broken.poses[20].translation, model[0].translation)
    np.testing.assert_allclose(np.diagonal(broken.covariances[20]), spread[0])
    assert np.trace(whole.covariances[20]) < 0.01 * spread.sum()


def test_the_robot_was_nowhere_faster_than_it_can_be():
    assert not jumps(circle(), NOISE).any()
    assert jumps(off_from(circle(), 50, [0.2, 0, 0]), NOISE).sum() == 1


def test_where_odometry_is_missing_the_motion_model_stands_in():
    track = circle()
    gap = track.select((track.ticks < 5_000_000) | (track.ticks > 9_000_000))
    keyframes = np.array([1_000_000, 4_000_000, 6_000_000, 8_000_000, 12_000_000])
    steps = steps_between(gap, keyframes, NOISE)
    assert steps.missing == 3
    np.testing.assert_allclose(np.sqrt(steps.covariances[1, 0, 0]), 0.8 * 2.0)


def test_covariances_compose_through_a_keyframe_or_past_it():
    noise = WayNoise()
    one = steps_between(circle(), np.array([0, 4_000_000]), noise)
    two = steps_between(circle(), np.array([0, 1_000_000, 4_000_000]), noise)
    first, second = two.poses[0], two.poses[1]
    # T = T1 + R1 T2, R = R1 R2: how an error of each step moves the end
    by_first, by_second = np.eye(6), np.eye(6)
    by_first[:3, 3:] = -first.rotation @ so3.hat(second.translation)
    by_first[3:, 3:] = second.rotation.T
    by_second[:3, :3] = first.rotation
    whole = by_first @ two.covariances[0] @ by_first.T + by_second @ two.covariances[1] @ by_second.T
    np.testing.assert_allclose(whole, one.covariances[0], atol=1e-3 * np.abs(whole).max())


@pytest.mark.parametrize("noise", [WayNoise(), WayNoise(slip_m=0.0, drift_m=1e-4), WayNoise(slip_rad=0.1)])
def test_what_is_driven_to_and_fro_is_as_uncertain_as_it_was_driven(noise):
    """Many robots drive the same way with errors of every tenth of a second: a bend, and turns that end where they
    began. The spread of where they come out is as stated."""
    t, rng, many = np.arange(0.0, 2.01, 0.1), np.random.default_rng(3), 4000
    heading = 0.8 * np.sin(np.pi * t)
    x = np.cumsum(np.append(0.0, 0.08 * np.cos(heading[:-1])))
    y = np.cumsum(np.append(0.0, 0.08 * np.sin(heading[:-1])))
    turns = np.stack([0 * t, 0 * t, heading], -1)
    track = Track(
        np.round(t * 1e6).astype(np.int64),
        Pose.from_tangent(np.concatenate([np.stack([x, y, 0 * t], -1), turns], -1), 3),
    )
    steps = track.poses[:-1].between(track.poses[1:])
    way, turned = np.linalg.norm(steps.translation, axis=1), np.abs(np.diff(heading))
    s = np.sqrt(noise.drift_m**2 * 0.1 + noise.slip_m**2 * way)
    r = np.sqrt(noise.drift_rad**2 * 0.1 + noise.slip_rad**2 * turned)
    came_out = Pose.identity(3, (many,))
    for k in range(len(steps)):
        error = rng.normal(size=(many, 6)) * np.repeat([s[k], r[k]], 3)
        came_out = came_out @ steps[np.full(many, k)].retract(error)
    found = steps_between(track, track.ticks[[0, -1]], noise)
    off = came_out.minus(found.poses[np.zeros(many, int)])
    half = np.linalg.cholesky(found.covariances[0])
    white = np.linalg.solve(half, np.cov(off.T)) @ np.linalg.inv(half).T
    np.testing.assert_allclose(white, np.eye(6), atol=5.0 / np.sqrt(many) + 0.03)


def test_messages_that_shake_do_not_lengthen_the_way():
    """Odometry whose every message is off by half a millimetre, 200 a second: the robot has not driven further."""
    track, keyframes = circle(5.0, 200.0), np.array([0, 2_000_000, 4_000_000])
    jitter = 5e-4 * np.random.default_rng(1).normal(size=(len(track), 3))
    shaking = Track(track.ticks, Pose(track.poses.rotation, track.poses.translation + jitter))
    still, shaken = (steps_between(seen, keyframes, NOISE).covariances for seen in (track, shaking))
    np.testing.assert_allclose(shaken, still, atol=0.02 * still.max())


def missed(track, every):
    """Odometry of which only every so many messages came, how far it is from the line where others were, and what is
    said of that."""
    kept = track.select(np.arange(len(track)) % every == 0)
    at = track.ticks[2 * every : -2 * every]
    inside = at[at < kept.ticks[-1]]
    true = track.poses[np.searchsorted(track.ticks, inside)]
    found, held = interpolate(kept.ticks, kept.poses, inside, 10**9)
    assert held.all()
    return found.minus(true), beside_the_line(kept, inside), np.isin(inside, kept.ticks)


def test_at_a_message_the_way_is_on_the_line_and_nearly_so_beside_it():
    for off, said, message in (missed(circle(), 10), missed(shaken(1), 10)):
        assert message.any() and not said[message].any() and np.abs(off[message]).max() < 1e-9
        assert (said[~message] > 0).all()
    track = shaken(2).select(np.arange(400) % 10 == 0)
    near, half = (beside_the_line(track, track.ticks[5:6] + late).max() for late in (10_000, 250_000))
    assert near < 0.3 * half


def test_a_smooth_way_bends_as_its_differences_say():
    off, said, message = missed(circle(), 10)  # 1 m/s round a circle of 5 m: half a second is 6 mm beside the chord
    bow = np.linalg.norm(off[~message, :3], axis=1).max()
    assert bow == pytest.approx(0.2 * 0.5**2 / 8, rel=0.05)
    assert 0.5 * bow < np.linalg.norm(said[:, :3], axis=1).max() < 2.0 * bow


def shaken(seed):
    """A camera in a hand that goes anywhere, at 20 messages a second."""
    steps = np.random.default_rng(seed).normal(size=(400, 6)) * [0.01, 0.01, 0.01, 0.02, 0.02, 0.02]
    places = np.cumsum(steps, 0)
    return Track(50_000 * np.arange(400), Pose.from_tangent(places * [1, 1, 1, 0.2, 0.2, 0.2], 3))


@pytest.mark.parametrize("seed", range(3))
def test_a_rough_way_is_as_far_from_the_line_as_said(seed):
    off, said, message = missed(shaken(seed), 4)
    for part in (slice(0, 3), slice(3, 6)):
        sigmas = np.mean((off[~message, part] / said[~message, part]) ** 2)
        assert 0.2 < sigmas < 1.2  # below 1, as of the differences near it the largest counts


def test_a_keyframe_between_messages_is_known_less_than_at_one():
    track = shaken(4).select(np.arange(400) % 10 == 0)
    at, between = (steps_between(track, track.ticks[5:9] + late, NOISE).covariances for late in (0, 250_000))
    assert (np.linalg.eigvalsh(between - at) >= -1e-12).all() and np.trace(between[0]) > 1.2 * np.trace(at[0])


def drives_and_looks_about(noise, seed, seconds=30.0, rate=50.0):
    """A robot on the ground that drives a bend, stands, and turns on the spot, and what its wheels say of it."""
    t, rng = np.arange(0.0, seconds, 1.0 / rate), np.random.default_rng(seed)
    within = (t % 10.0) / 10.0
    speed = np.where(within < 0.4, 0.3 * np.sin(np.pi * within / 0.4) ** 2, 0.0)
    turning = np.where(within > 0.6, 1.5 * np.sin(np.pi * (within - 0.6) / 0.4) ** 2, 0.4 * speed)
    step = np.stack([speed[1:], 0 * t[1:], turning[1:]], -1) / rate
    s = np.sqrt(noise.drift_m**2 / rate + noise.slip_m**2 * np.abs(step[:, 0]))
    r = np.sqrt(noise.drift_rad**2 / rate + noise.slip_rad**2 * np.abs(step[:, 2]))

    def led(steps):
        steps = Pose.from_xytheta(steps).lift(3)
        return Track(np.round(1e6 * t).astype(np.int64), compose_along(steps))

    return led(step), led(step + np.stack([s, s, r], -1) * rng.normal(size=step.shape))


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_noise_of_odometry_is_no_way_that_was_driven(rate):
    """What is stated of steps is what they err by, of a robot that stands and turns, too, however often odometry comes:
    chi-square within three of its own deviations."""
    noise = WayNoise(drift_m=1e-3, slip_m=0.01, drift_rad=1e-3, slip_rad=0.015)
    keyframes = np.arange(500_000, 29_000_000, 500_000)
    parts = []
    for seed in range(30):
        true, odometry = drives_and_looks_about(noise, seed, rate=rate)
        steps = steps_between(odometry, keyframes, noise)
        off = steps.poses.minus(steps_between(true, keyframes, noise).poses)
        half = np.linalg.cholesky(steps.covariances[:, [[0], [1], [5]], [0, 1, 5]])
        white = np.linalg.solve(half, off[:, [0, 1, 5], None])
        parts.append(np.mean(white[..., 0] ** 2, 0))
    count = len(parts) * (len(keyframes) - 1)
    np.testing.assert_allclose(np.mean(parts, 0), 1.0, atol=3.0 * np.sqrt(2.0 / count) + 0.02)
