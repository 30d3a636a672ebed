"""Corners that were not seen at the instant of their keyframe: a rolling shutter reads line after line, and an image
may be taken a little beside the keyframe that it is used for.

Eye E sees corner c of body B at t + d, in direction u. What it would have seen at t follows from how both moved:

    P c  =  M_E q + R_P (c - M_B c),     q = r u = M_E^-1 P M_B c,     M_X = X(t)^-1 X(t + d),     P = E(t)^-1 B(t)

The motions are odometry's (`frontend.moments`). P is the pose that the corners tell, first as they were seen, then as
they would have been: of it only the distance r counts for the eye's motion, so that the noise of u stays what it is.
What odometry errs by moves all corners of a tag, each by how late it was seen:

    du  =  w_E x u + v_E / r - R_P (w_B x c + v_B) / r     across u, with M_X (+) (v_X, w_X), each d times one velocity
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, s2, so3
from teamslam.geometry.resection import nearest, resect

ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Motion:
    """How the eye and the bodies moved (m, k) from the instant of their keyframes until each of k points was seen; and
    by how much these motions err (m, k, 6, 6), for a sigma of each of six numbers that are alike for all k, where that
    is known."""

    eye: Pose
    body: Pose
    eye_errs: Array | None = None
    body_errs: Array | None = None

    def of(self, rows: IntArray) -> "Motion":
        """That of some of the m."""
        errs = (None if each is None else each[rows] for each in (self.eye_errs, self.body_errs))
        return Motion(self.eye[rows], self.body[rows], *errs)


def at_one_instant(
    rays: Array, points: Array, whitening: Array, motion: Motion, standing: Pose | None = None
) -> tuple[Array, Pose]:
    """The directions (m, 4, 3) in which corners would have been seen at the instant of the keyframe, from those in
    which they were seen; `points` (m, 4, 3) are the corners in the bodies' frames, `whitening` (m, 8, 8) that of the
    directions. With `standing` (m,), how the bodies stood to the eye at the keyframe, nothing is looked for. And how
    they stood.

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
    return here, pose


def erring(rays: Array, points: Array, motion: Motion, standing: Pose) -> Array:
    """By how much directions at the keyframe's instant (m, 4, 3) err, in the axes of `s2` (m, 8, 12), for a sigma of
    each of the numbers of `motion`, the eye's and the bodies'. Of standing bodies seen by a standing eye nothing."""
    basis = np.swapaxes(s2.direction_basis(rays), -1, -2)
    apart = points @ np.swapaxes(standing.rotation, -1, -2) + standing.translation[:, None]
    near = 1.0 / np.linalg.norm(apart, axis=-1)[..., None, None]
    zero = np.zeros((*rays.shape[:2], 6, 6))
    eye, body = (zero if errs is None else errs for errs in (motion.eye_errs, motion.body_errs))
    by_eye = near * eye[..., :3, :] - so3.hat(rays) @ eye[..., 3:, :]
    by_body = near * (standing.rotation[:, None] @ (so3.hat(points) @ body[..., 3:, :] - body[..., :3, :]))
    return np.asarray((basis @ np.concatenate([by_eye, by_body], -1)).reshape(len(rays), 8, 12))


def points_at_one_instant(points: Array, motion: Motion, standing: Pose) -> Array:
    """Where points (m, k, 3) of bodies would have been before the eye at the instant of the keyframe, from where they
    were when each was measured; bodies stood so to the eye (m,) at the keyframe.

    Law: exact, and where bodies did not move, however they stood.
    """
    there = standing[:, None]
    return there.act(motion.body.unact(there.unact(motion.eye.act(points))))
