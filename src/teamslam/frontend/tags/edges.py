"""How wide the edges of tags are in an image: out of focus, smeared by motion, or sharp.

Across an edge that is blurred by a Gaussian of deviation w the grey rises from P0 to P1 with a slope of at most
(P1 - P0) / (w sqrt(2 pi)). So w is read off the profile across the edge, the mean of ACROSS profiles along it:

    w = (P1 - P0) / (sqrt(2 pi) max dP/ds)

Motion along an edge leaves it sharp, motion across it widens it: the edges of one tag have widths of their own. A tag
that the border of the image cuts is found all the same, with an edge where the image ends: of that nothing is known.
"""

import numpy as np

from teamslam.geometry import AnyArray, Array, BoolArray

ACROSS = 12  # profiles an edge, from 0.15 to 0.85 of its length: the ends belong to corners
SAMPLES = 25
MODULE = 0.11  # of a tag's side, a little less than the eighth that a black frame is wide in most families
FARTHEST = 6.0  # pixels to each side
FLATTEST = 8.0  # grey values between black and white: with less there is no edge to speak of
SHARP = 0.8  # the width of an edge in focus [pixels]: NARROWEST, and 0.5 of a good lens
BORDER = 6.0  # pixels beyond an edge that must be in the image: twice as far as it is looked for from where it seems
CUT = 1000.0  # the width of an edge that says nothing [pixels]
NARROWEST = 3.0**-0.5  # what pixels, reading between them, and differences over one make of a perfect edge


def edge_widths(image: AnyArray, corners: Array) -> Array:
    """The width (m, 4) [pixels] of each edge of tags with corners (m, 4, 2), edge k from corner k to the next; SHARP
    where the image shows no edge (no contrast), CUT where the edge is at its border or beyond.

    Law: of an image that was blurred by b, sqrt(b^2 + NARROWEST^2), while that is well below a cell of the tag.
    """
    if not len(corners):
        return np.zeros((0, 4))
    along = np.roll(corners, -1, 1) - corners
    length = np.linalg.norm(along, axis=-1)
    normal = np.stack([along[..., 1], -along[..., 0]], -1) / np.maximum(length, 1e-9)[..., None]
    reach = np.clip(MODULE * length.mean(1), 1.0, FARTHEST)  # (m,)
    s = np.linspace(-1.0, 1.0, SAMPLES) * reach[:, None]  # (m, SAMPLES)
    t = np.linspace(0.15, 0.85, ACROSS)
    feet = corners[:, :, None] + t[:, None] * along[:, :, None]  # (m, 4, ACROSS, 2)
    points = feet[:, :, :, None] + s[:, None, None, :, None] * normal[:, :, None, None]
    profile = _grey(image, points).mean(2)  # (m, 4, SAMPLES)
    slope = np.abs(profile[..., 2:] - profile[..., :-2]).max(-1) / (s[:, 2] - s[:, 0])[:, None]
    rise = profile.max(-1) - profile.min(-1)
    clear = (rise > FLATTEST) & (slope > 0.0)
    widths = rise / (np.sqrt(2.0 * np.pi) * np.where(clear, slope, 1.0))
    found = np.where(clear, np.clip(widths, NARROWEST, reach[:, None]), SHARP)
    return np.where(_at_border(image, corners, normal), CUT, found)


def _at_border(image: AnyArray, corners: Array, normal: Array) -> BoolArray:
    """Which edges (m, 4) have no image beyond them, at one of their ends at least."""
    ends = np.stack([corners, np.roll(corners, -1, 1)], 2)  # (m, 4, 2 ends, 2)
    outwards = np.sign(np.sum((ends.mean(2) - corners.mean(1)[:, None]) * normal, -1))[..., None] * normal
    beyond = ends + BORDER * outwards[:, :, None]
    height, width = image.shape
    return np.asarray(((beyond < 0.0) | (beyond > [width - 1.0, height - 1.0])).any((-1, -2)))


def _grey(image: AnyArray, points: Array) -> Array:
    """The image at points (..., 2), between its pixels in proportion; beyond its border as at the border."""
    height, width = image.shape
    x = np.clip(points[..., 0], 0.0, width - 1.0)
    y = np.clip(points[..., 1], 0.0, height - 1.0)
    left, top = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    u, v = x - left, y - top
    upper = (1.0 - u) * image[top, left] + u * image[top, right]
    lower = (1.0 - u) * image[below, left] + u * image[below, right]
    return np.asarray((1.0 - v) * upper + v * lower)
