"""Corners in images become rows of the model `corners`: directions, with what each is known to, and where the corners
are in the body that carries the tag.

Directions are kept in axes that look along x (x ahead, y left, z up), so that azimuth and elevation are what people
mean by them; `LOOKING` is how these stand in a camera's own axes (z ahead, x right, y down).
"""

from dataclasses import dataclass

import numpy as np

from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.late import Motion, at_one_instant, erring
from teamslam.frontend.tags.noise import corner_covariances
from teamslam.geometry import Array, BoolArray, Pose, s2

LOOKING = Pose(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.zeros(3))
SQUARE = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
"""The corners of a tag of edge 1 in its own frame: x right, y up, z towards who reads it."""


@dataclass(frozen=True)
class Tag:
    """A tag by its `number`: which landmark or robot carries it, where (pose of the tag in the carrier; None: at its
    origin), and the edge of its black square [m]."""

    number: int
    size_m: float
    carrier: str
    is_robot: bool = False
    pose: Pose | None = None

    @property
    def corners(self) -> Array:
        """Its corners (4, 3) in the carrier's frame."""
        flat = self.size_m * SQUARE
        return flat if self.pose is None else self.pose.act(flat)


def corner_rows(
    seen: TagCorners,
    camera: Camera,
    tags: list[Tag],
    floor: float,
    edge: float,
    motion: Motion | None = None,
    standing: Pose | None = None,
) -> tuple[Array, Array, BoolArray]:
    """Values (m, 24) and whitening (m, 8, 8) of the model `corners`, and which rows (m,) have a direction at each
    corner; `tags` (m,) are those that were seen. `motion` (m, 4) is that of the eye, in axes that look along x, and of
    the tags' carriers, until each corner was seen; None: all were seen at the instant of the keyframe. `standing` (m,)
    is how the carriers stood to the eye then, where that is known."""
    rays, good = camera.rays(seen.corners)
    turned = rays @ LOOKING.rotation
    slopes = camera.ray_slopes(seen.corners)  # in the axes of the camera
    basis, axes = s2.direction_basis(rays), s2.direction_basis(turned)
    across = np.swapaxes(axes, -1, -2) @ LOOKING.rotation.T @ basis @ slopes
    usable = good.all(-1) & (np.linalg.det(across) != 0.0).all(-1)
    in_pixels = np.linalg.inv(np.where(usable[:, None, None, None], across, np.eye(2)))
    sheared = np.zeros((len(seen), 8, 8))
    for k in range(4):
        sheared[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = in_pixels[:, k]
    root = np.linalg.cholesky(corner_covariances(seen.corners, floor, edge, seen.widths))
    whitening = np.linalg.solve(root, sheared)
    places = np.array([tag.corners for tag in tags]).reshape(-1, 12)
    if motion is not None and usable.any():
        rows = np.flatnonzero(usable)
        part = motion.of(rows)
        known = None if standing is None else standing[rows]
        points = places[rows].reshape(-1, 4, 3)
        turned[rows], stood = at_one_instant(turned[rows], points, whitening[rows], part, known)
        whitening[rows] = _with(whitening[rows], erring(turned[rows], points, part, stood))
    return np.concatenate([turned.reshape(-1, 12), places], -1), whitening, usable


def _with(whitening: Array, errors: Array) -> Array:
    """The whitening (m, 8, 8) of rows that also err by some columns (m, 8, k), each of one sigma."""
    white = whitening @ errors
    if not white.any():
        return whitening
    root = np.linalg.cholesky(np.eye(white.shape[1]) + white @ np.swapaxes(white, -1, -2))
    return np.asarray(np.linalg.solve(root, whitening))
