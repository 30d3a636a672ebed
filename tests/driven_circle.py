"""Odometry along a circle that climbs, as it was driven or with a jump in it."""

import numpy as np

from teamslam.frontend.streams import Track
from teamslam.geometry import Pose


def circle(seconds=20.0, rate=20.0):
    """At 1 m/s, turning by 0.2 rad/s and climbing by 0.1 m/s."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    place = np.stack([5 * np.sin(0.2 * t), 5 - 5 * np.cos(0.2 * t), 0.1 * t], -1)
    poses = Pose.from_tangent(np.stack([0 * t] * 5 + [0.2 * t], -1), 3)
    return Track((t * 1e6).astype(np.int64), Pose(poses.rotation, place))


def off_from(track, since, by):
    """A track that was off from a message on."""
    place = track.poses.translation.copy()
    place[since:] += by
    return Track(track.ticks, Pose(track.poses.rotation, place))
