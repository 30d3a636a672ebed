"""What is stated of a robot's motion, and which steps of odometry are none that it can have made."""

import msgspec
import numpy as np

from teamslam.frontend.streams import TICKS_PER_S, Track
from teamslam.geometry import BoolArray, Pose


class WayNoise(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is stated of a robot's motion: `speed_m_s` and `turn_rad_s`, the usual ones of the motion model;
    `fastest_m_s`, beyond which odometry jumped; its noise per root of a second and of a metre (`drift_m`, `slip_m`),
    and per root of a second and of a radian in turning (`drift_rad`, `slip_rad`)."""

    speed_m_s: float = 1.0
    turn_rad_s: float = 1.0
    fastest_m_s: float = 3.0
    fastest_rad_s: float = 6.0
    drift_m: float = 0.01
    slip_m: float = 0.03
    drift_rad: float = 0.003
    slip_rad: float = 0.02


def jumps(track: Track, noise: WayNoise) -> BoolArray:
    """Which steps (n - 1,) of odometry in time order are faster than the robot can be."""
    dt = np.diff(track.ticks) / TICKS_PER_S
    step = track.poses[:-1].between(track.poses[1:])
    way = np.linalg.norm(step.translation, axis=-1)
    turn = np.linalg.norm(step.minus(Pose.identity(3, (len(dt),)))[:, 3:], axis=-1)
    return np.asarray((way > noise.fastest_m_s * dt) | (turn > noise.fastest_rad_s * dt))
