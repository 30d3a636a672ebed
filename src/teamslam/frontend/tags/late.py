"""Corners that were not seen at the instant of their keyframe: a rolling shutter reads line after line, and an image
may be taken a little beside the keyframe that it is used for.

Eye E sees corner c of body B at t + d, in direction u. What it would have seen at t follows from how both moved:

    P c  =  M_E q + R_P (c - M_B c),     q = r u = M_E^-1 P M_B c,     M_X = X(t)^-1 X(t + d),     P = E(t)^-1 B(t)

The motions are odometry's (`frontend.moments`). P is the pose that the corners tell, first as they were seen, then as
they would have been: of it only the distance r counts for the eye's motion, so that the noise of u stays what it is.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose, s2
from teamslam.geometry.resection import nearest, resect

ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Motion:
    """How the eye and the bodies moved (m, k) from the instant of their keyframes until each of k points was seen."""

    eye: Pose
    body: Pose


def at_one_instant(rays: Array, points: Array, whitening: Array, motion: Motion, standing: Pose | None = None) -> Array:
    """The directions (m, 4, 3) in which corners would have been seen at the instant of the keyframe, from those in
    which they were seen; `points` (m, 4, 3) are the corners in the bodies' frames, `whitening` (m, 8, 8) that of the
    directions. With `standing` (m,), how the bodies stood to the eye at the keyframe, nothing is looked for.

    Law: exact for directions without noise, up to the ROUNDS-th power of the motion, where these tell one pose.
    """
    here, pose = rays, resect(rays, points, whitening).poses[:, 0] if standing is None else standing
    for number in range(ROUNDS if standing is None else 1):
        pose = nearest(pose, here, points, whitening) if number else pose
        moved = motion.body.act(points)
        there = motion.eye.unact(moved @ np.swapaxes(pose.rotation, -1, -2) + pose.translation[:, None])
        distance = np.linalg.norm(there, axis=-1, keepdims=True)
        shift = (points - moved) @ np.swapaxes(pose.rotation, -1, -2)
        here = s2.of(motion.eye.act(distance * rays) + shift)
    return here


def points_at_one_instant(points: Array, motion: Motion, standing: Pose) -> Array:
    """Where points (m, k, 3) of bodies would have been before the eye at the instant of the keyframe, from where they
    were when each was measured; bodies stood so to the eye (m,) at the keyframe.

    Law: exact, and where bodies did not move, however they stood.
    """
    there = standing[:, None]
    return there.act(motion.body.unact(there.unact(motion.eye.act(points))))
