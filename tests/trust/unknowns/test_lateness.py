"""How late a camera is, of one that is not, or is: without bias, within its sigma, soon; whatever odometry is like."""

import numpy as np
import pytest

from late_room import Drive, read
from teamslam.solver import Options
from teamslam.trust.unknowns import settled


def found(drive, seeds):
    """What was found beside the truth and its sigma [s], by seed."""
    out = []
    for seed in seeds:
        known = settled(read(drive, seed), Options())
        assert known.settled
        assert known.rounds <= (8 if drive.noise == "messages" else 4)  # wider means of it reach less far at once
        out.append((known.found[0].value - drive.late_s, known.found[0].sigma))
    return np.array(out).T


def test_noise_of_corners_makes_no_camera_early():
    """A robot that drives on evenly, with odometry as it is: by directions as they were seen this camera was told to
    stamp 40 ms early, five times its sigma."""
    off, sigma = found(Drive(dim=2, odometry_hz=48.0, noise="", every_s=0.0, seconds=20.0), range(2))
    assert (np.abs(off) < 1.5 * sigma).all()


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    ("odometry_hz", "phase", "late_s", "swing"),
    [(8.0, 0.0, 0.0, 0.1), (8.0, 0.3, 0.03, 0.1), (20.0, 0.5, 0.12, 1.0), (100.0, 0.0, 0.03, 1.0)],
)
@pytest.mark.parametrize("noise", ["steps", "messages"])
def test_a_latency_is_told_without_bias_and_within_its_sigma(dim, odometry_hz, phase, late_s, swing, noise):
    count = 6
    drive = Drive(dim=dim, odometry_hz=odometry_hz, phase=phase, late_s=late_s, swing=swing, noise=noise)
    off, sigma = found(drive, range(count))
    z = off / sigma
    assert abs(z.mean()) < 4.0 / np.sqrt(count)
    assert np.mean(z**2) < 1.0 + 4.0 * np.sqrt(2.0 / count)
    assert noise == "messages" or np.mean(z**2) > 0.05
