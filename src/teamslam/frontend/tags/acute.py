"""Corners of tags that are seen aslant: what the edge beyond an acute corner does to the line of the one before it.

The AprilTag library places each point of an edge at the centre of the squared grey slopes along the normal, REACH
pixels to each side, each slope between pixels one to each side. Where two edges meet at an acute angle those near the
corner see the other edge, too: between the two the tag's frame is a wedge that blur fills, and the centre of what is
left of the slope lies outside of the edge. The line through all points is turned about its middle: up to a pixel at the
ends of an edge of 14 pixels, the same way in all images that are alike. It follows from the angle and the blur, without
a number of its own:

    the frame     at p it is dark by P(u < d / w, u' < d' / w'), u and u' Gaussian with correlation -cos(angle):
                  d, d' how far p is inside of the two edges, w, w' how wide these are (`edges`)
    a point       at s from the corner: the centre of its squared slopes
    a line        least squares of n = max(16, L / 8) points, evenly along the edge
    a corner      where two lines cross (`noise.by_lines`)
"""

import numpy as np

from teamslam.frontend.tags.edges import CUT, NARROWEST
from teamslam.frontend.tags.noise import EVERY_PX, POINTS, by_lines
from teamslam.geometry import Array

STEP = 0.25  # pixels between places of a slope
TO_EACH_SIDE = 1.0  # pixels, of what a slope is between
REACH = 2.0  # pixels, of an image that is looked at whole; the library adds 1 to by how much it is made smaller
FARTHEST = 3.0  # widths from an edge, beyond which nothing is seen of it
ROUND = 1e-3  # cosine of the angle of a corner: below, nothing moves
NODES, SHARES = np.polynomial.legendre.leggauss(8)


def unturned(corners: Array, widths: Array, reach: float = REACH) -> Array:
    """Where the corners of tags (m, 4, 2) [pixels] are that the library found, its edges `widths` (m, 4) wide as
    `edge_widths` has them; what is CUT turns nothing, and is as wide as the edge that it meets.

    Law: rectangles stay as they are.
    """
    if not len(corners):
        return corners
    along = np.roll(corners, -1, 1) - corners
    length = np.maximum(np.linalg.norm(along, axis=-1), 1.0)
    t = along / length[..., None]
    cosine = np.clip(-np.sum(t * np.roll(t, 1, 1), -1), -1.0, 1.0)  # of the angle at each corner
    before = np.roll(widths, 1, 1)
    starts = _turned(length, cosine, widths, before, reach)
    ends = _turned(length, np.roll(cosine, -1, 1), widths, np.roll(widths, -1, 1), reach)
    outwards = starts + ends[..., ::-1]  # of each line, at its two ends
    middle = 0.5 * (corners + np.roll(corners, -1, 1)) - corners.mean(1)[:, None]
    side = np.sign(middle[..., 0] * t[..., 1] - middle[..., 1] * t[..., 0])
    moved = np.einsum("mikr,mkr->mi", by_lines(t), side[..., None] * outwards)
    return np.asarray(corners - moved.reshape(-1, 4, 2))


def _turned(length: Array, cosine: Array, width: Array, other: Array, reach: float) -> Array:
    """How far outwards lines (m, 4) are moved at the end with a corner of such an angle, and at the other (m, 4, 2)."""
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-6))
    wide = np.maximum(width, NARROWEST)
    beside = np.where(other < CUT, np.maximum(other, NARROWEST), wide)
    count = np.maximum(POINTS, np.floor(length / EVERY_PX))
    x = (np.arange(POINTS) + 1.0) / (count + 1.0)[..., None]  # (m, 4, POINTS) of the length, the nearest points
    s = x * length[..., None]
    seen = s * sine[..., None] < ((reach + TO_EACH_SIDE) * np.abs(cosine) + FARTHEST * beside)[..., None]
    seen &= (width < CUT)[..., None] & (np.abs(cosine) > ROUND)[..., None]
    off = np.zeros(s.shape)
    row = np.nonzero(seen)[:2]
    off[seen] = _centres(s[seen], cosine[row], sine[row], wide[row], beside[row], reach)
    mean = off.sum(-1) / count
    slope = (off * (x - 0.5)).sum(-1) * 12.0 * (count + 1.0) / (count * (count - 1.0))
    return np.stack([mean - 0.5 * slope, mean + 0.5 * slope], -1)


def _centres(s: Array, cosine: Array, sine: Array, width: Array, other: Array, reach: float) -> Array:
    """How far outwards points (k,) are placed that are s [pixels] from a corner."""
    far = reach + TO_EACH_SIDE
    out = np.linspace(-far, far, round(2.0 * far / STEP) + 1)
    inside = -out / width[:, None], (s[:, None] * sine[:, None] + out * cosine[:, None]) / other[:, None]
    dark = _both(*inside, -cosine[:, None])
    apart = round(2.0 * TO_EACH_SIDE / STEP)
    slopes = np.maximum(dark[:, :-apart] - dark[:, apart:], 0.0) ** 2
    return np.asarray((slopes @ np.linspace(-reach, reach, slopes.shape[1])) / np.maximum(slopes.sum(-1), 1e-12))


def _both(h: Array, k: Array, correlation: Array) -> Array:
    """P(u < h, u' < k) of Gaussians: by Plackett, an integral over the arc sine of their correlation."""
    from scipy.special import ndtr

    arc = 0.5 * np.arcsin(correlation)[..., None]
    sine = np.sin(arc * (NODES + 1.0))
    h_, k_ = h[..., None], k[..., None]
    exponent = (h_ * h_ - 2.0 * sine * h_ * k_ + k_ * k_) / (2.0 * (1.0 - sine * sine))
    return np.asarray(ndtr(h) * ndtr(k) + np.sum(arc * SHARES * np.exp(-exponent), -1) / (2.0 * np.pi))
