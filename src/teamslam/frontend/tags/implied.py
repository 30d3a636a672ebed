"""The corners that a pose of a tag implies, where a detector tells poses only.

A pose was made of four corners, and says less than they did: where the tag is small, or seen from the front, another
pose fits them as well, and how well it is known nobody tells (detectors write zeros). So it is put back into what it
came from: the corners of a tag of the size that the detector took it for, where the camera would see them. As corners
they have the noise of corners, and stand for both poses; and a size that the detector was told wrongly goes out again.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Array, BoolArray, IntArray, Pose


@dataclass(frozen=True, eq=False)
class TagPoses:
    """Tags in images as poses in the camera (z ahead, x right): `frames`, `frame` and `ids` as in `TagCorners`, `poses`
    (m,), and the edges (m,) [m] that the detector took tags for; NaN where it does not say."""

    frames: IntArray
    frame: IntArray
    ids: IntArray
    poses: Pose
    sizes_m: Array

    def __len__(self) -> int:
        return len(self.ids)


def implied_corners(seen: TagPoses, camera: Camera, sizes_m: Array) -> tuple[TagCorners, BoolArray]:
    """The corners that poses imply, and which of the poses (m,) no camera can have seen: those are left out.

    `sizes_m` (m,) are the edges that count where the detector does not say. A tag is seen from its front, so its z
    looks towards the camera; detectors whose z looks into the tag (and y down) are turned about x. Law: corners of a
    pose, taken from an image, give the pose again where that is the only one.
    """
    size = np.where(np.isfinite(seen.sizes_m), seen.sizes_m, sizes_m)
    into = np.sum(seen.poses.rotation[..., 2] * seen.poses.translation, -1) > 0.0
    turned = np.where(into[:, None, None], seen.poses.rotation * np.array([1.0, -1.0, -1.0]), seen.poses.rotation)
    corners = size[:, None, None] * SQUARE
    places = corners @ np.swapaxes(turned, -1, -2) + seen.poses.translation[:, None]
    pixels = camera.project(places)
    good = np.asarray(np.isfinite(pixels).all((-1, -2)), bool)
    return (
        TagCorners(
            seen.frames,
            seen.frame[good],
            seen.ids[good],
            pixels[good],
            np.zeros(int(good.sum()), np.int64),
            ("",) * int(good.sum()),
        ),
        ~good,
    )
