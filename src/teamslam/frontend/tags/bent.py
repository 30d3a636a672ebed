"""Corners of tags where lenses bend edges.

The AprilTag library fits a straight line to points along each edge, and a corner is where two of these cross. An edge
that is straight in space is bent in the image of a lens that distorts, by the square of its length, and the lines of a
large tag far from the middle of the image cross some tenths of a pixel from where its corner is.

    an edge     the points between two corners' rays, as the camera shows them: at n = max(16, L / 8) places along it
    a line      least squares of these, as the library's
    bent        where two lines cross (-) the corner, at the corners as found; to first order in it
"""

from dataclasses import replace

import numpy as np

from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.noise import FLATTEST, POINTS
from teamslam.geometry import Array

ROUNDS = 2


def unbent(corners: Array, camera: Camera) -> Array:
    """Where the corners of tags (m, 4, 2) [pixels] are, of which those are given at which straight lines cross that are
    fitted to their edges; as given where the camera cannot tell.

    Law: exact to the second order of how far edges are bent; nothing moves for a lens without distortion.
    """
    found = corners
    for _ in range(ROUNDS):
        bent = _crossings(found, camera) - found
        found = np.where(np.isfinite(bent).all((-1, -2), keepdims=True), corners - bent, corners)
    return np.asarray(found)


def straightened(seen: TagCorners, camera: Camera) -> TagCorners:
    """What was seen, its corners where they are (`unbent`)."""
    return replace(seen, corners=unbent(seen.corners, camera))


def _crossings(corners: Array, camera: Camera) -> Array:
    """Where lines cross (m, 4, 2) that are fitted to the edges between corners; NaN where some are not shown."""
    rays, good = camera.rays(corners)
    share = ((np.arange(POINTS) + 1.0) / (POINTS + 1.0))[:, None]
    between = (1.0 - share) * rays[:, :, None] + share * np.roll(rays, -1, 1)[:, :, None]
    points = camera.project(
        np.where(np.asarray(good.all(-1))[:, None, None, None], between, np.nan)
    )  # (m, 4, POINTS, 2)
    middle = points.mean(2)
    off = points - middle[:, :, None]
    spread = np.swapaxes(off, -1, -2) @ off
    angle = 0.5 * np.arctan2(2.0 * spread[..., 0, 1], spread[..., 0, 0] - spread[..., 1, 1])
    t = np.stack([np.cos(angle), np.sin(angle)], -1)
    before, start = np.roll(t, 1, 1), np.roll(middle, 1, 1)
    sine = before[..., 0] * t[..., 1] - before[..., 1] * t[..., 0]
    across = middle - start
    with np.errstate(divide="ignore", invalid="ignore"):
        steep = np.where(np.abs(sine) > FLATTEST, sine, np.nan)
        along = (across[..., 0] * t[..., 1] - across[..., 1] * t[..., 0]) / steep
    return np.asarray(start + along[..., None] * before)
