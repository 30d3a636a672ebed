"""How wide the edges of tags are in an image: out of focus, smeared by motion, or sharp.

Across an edge that is blurred by a Gaussian of deviation w the grey rises from P0 to P1 with a slope of at most
(P1 - P0) / (w sqrt(2 pi)). So w is read off the profile across the edge, the mean of ACROSS profiles along it:

    w = (P1 - P0) / (sqrt(2 pi) max dP/ds)

Motion along an edge leaves it sharp, motion across it widens it: the edges of one tag have widths of their own. A tag
that the border of the image cuts is found all the same, with an edge where the image ends: of that nothing is known.

Nor of one that another thing covers in part, whose border draws the line away, by pixels. It shows in single profiles,
d(t) being the centre of the squared slopes at t along the edge, less the bow that a lens makes of a straight edge (a
parabola without mean and slope), and c(t) the rise as a share of the brighter side:

    |d(t)| > OFF + SIGMAS * deviation of d                 there the edge is not on its line
    |slope of d| / 2 > OFF / 2 + SIGMAS * deviation of it  the line is turned, though no profile tells it by itself
    rise(t), c(t) < FAINT * upper quartile                 there is no edge; a shadow dims both sides, not c

The deviation is that of all profiles of the tag (from the median), the quartiles are those of the edge: a tag is beside
itself, so that noise, exposure, shadows and narrow margins cancel. Which side is bright follows from all four edges, as
some families have a white frame in a black one. Not seen is what covers an edge from end to end, or is as bright as the
margin and less than half a cell deep in the frame, or moves no point by OFF; nor anything where cells are not CLEAR
widths wide or the rise is below FAINTEST.
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
CELLS = 8.0  # of a tag's side, in families that have most
CLEAR = 3.0  # widths of an edge in a cell: with less, what is beyond it is seen across it
NEAR = 0.6  # of a cell: as far to each side as frame and margin are looked at
FAINTEST = 20.0  # grey values between black and white, 5 sigmas of a poor sensor: with less, profiles say nothing
OFF, SIGMAS, FAINT = 0.3, 5.0, 0.5
NARROWEST = 3.0**-0.5  # what pixels, reading between them, and differences over one make of a perfect edge

PLACES = np.linspace(0.15, 0.85, ACROSS)  # of profiles along an edge
BOW = 6.0 * (PLACES - 0.5) ** 2 - 0.5  # Legendre's second
BOW /= np.linalg.norm(BOW)
TURN = 2.0 * (PLACES - 0.5)
TURN /= TURN @ TURN  # the inner product with it is how far off a line through d(t) is at the ends
MEDIAN = 0.6745  # of a Gaussian's distances from its mean, in deviations


def edge_widths(image: AnyArray, corners: Array) -> Array:
    """The width (m, 4) [pixels] of each edge of tags with corners (m, 4, 2), edge k from corner k to the next; SHARP
    where the image shows no edge (no contrast), CUT where the edge is at its border or beyond, or covered in part.

    Law: of an image that was blurred by b, sqrt(b^2 + NARROWEST^2), while that is well below a cell of the tag.
    """
    if not len(corners):
        return np.zeros((0, 4))
    along = np.roll(corners, -1, 1) - corners
    length = np.linalg.norm(along, axis=-1)
    normal = np.stack([along[..., 1], -along[..., 0]], -1) / np.maximum(length, 1e-9)[..., None]
    reach = np.clip(MODULE * length.mean(1), 1.0, FARTHEST)  # (m,)
    s = np.linspace(-1.0, 1.0, SAMPLES) * reach[:, None]  # (m, SAMPLES)
    feet = corners[:, :, None] + PLACES[:, None] * along[:, :, None]  # (m, 4, ACROSS, 2)
    points = feet[:, :, :, None] + s[:, None, None, :, None] * normal[:, :, None, None]
    profiles = grey_at(image, points)  # (m, 4, ACROSS, SAMPLES)
    profile = profiles.mean(2)
    slope = np.abs(profile[..., 2:] - profile[..., :-2]).max(-1) / (s[:, 2] - s[:, 0])[:, None]
    rise = profile.max(-1) - profile.min(-1)
    clear = (rise > FLATTEST) & (slope > 0.0)
    widths = rise / (np.sqrt(2.0 * np.pi) * np.where(clear, slope, 1.0))
    found = np.where(clear, np.clip(widths, NARROWEST, reach[:, None]), SHARP)
    unknown = _at_border(image, corners, normal) | _covered(profiles, s, found, cell_widths(corners))
    return np.where(unknown, CUT, found)


def cell_widths(corners: Array) -> Array:
    """How wide a cell of tags with corners (m, 4, 2) is across each edge (m, 4) [pixels], at that edge; in families of
    fewer cells it is wider.

    Law: of a tag that leans, whose edges are Z1 and Z2 away, the cells at the first are Z2 / Z1 times as wide as in
    the mean, and its edges are in the same ratio.
    """
    following = corners[:, [1, 2, 3, 0]]
    along = following - corners
    to = corners[:, [2, 3, 0, 1]] + corners[:, [3, 0, 1, 2]] - corners - following
    across = np.abs(along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0])
    opposite = np.linalg.norm(along[:, [2, 3, 0, 1]], axis=-1)
    return np.asarray(0.5 / CELLS * across / np.maximum(opposite, 1e-9))


def _covered(profiles: Array, s: Array, widths: Array, cells: Array) -> BoolArray:
    """Which edges (m, 4) another thing covers in part, by profiles (m, 4, ACROSS, SAMPLES) at s (m, SAMPLES) [pixels]
    from them. What is wide because it is covered, is as wide as the edge on the other side."""
    covered = cells > CLEAR * np.minimum(widths, widths[:, [2, 3, 0, 1]])
    tags = np.nonzero(covered.any(1))[0]
    if not len(tags):
        return covered
    grey, s = profiles[tags], s[tags, None, None]
    slope = grey[..., 2:] - grey[..., :-2]
    squares = slope * np.abs(slope)
    middle = slice(SAMPLES // 3, -(SAMPLES // 3))  # a narrow margin ends beyond
    upwards = np.sign(squares[..., middle].sum((1, 2, 3)))[:, None, None, None]  # which way the steepest go
    near = np.abs(s) <= NEAR * cells[tags, :, None, None]
    rise, share = _rise(grey * upwards, near)
    off, turned = _off(np.maximum(squares * upwards, 0.0) * near[..., 1:-1], s[..., 1:-1])
    faint = (rise < FAINT * _ranked(rise, 0.75)[..., None]) & (share < FAINT * _ranked(share, 0.75)[..., None])
    usual, contrast = (_ranked(x.reshape(len(tags), -1), 0.5)[:, None] for x in (off, rise))
    far = off.max(-1) > OFF + SIGMAS / MEDIAN * usual
    far |= turned > 0.5 * OFF + SIGMAS / MEDIAN * np.linalg.norm(TURN) * usual
    covered[tags] &= (faint.any(-1) | far) & (contrast > FAINTEST)
    return covered


def _rise(grey: Array, near: BoolArray) -> tuple[Array, Array]:
    """By how much each profile (..., SAMPLES) rises where it is near, and as a share of its brighter side."""
    half = SAMPLES // 2
    low = np.where(near, grey, np.inf)[..., : half + 1].min(-1)
    high = np.where(near, grey, -np.inf)[..., half:].max(-1)
    return high - low, (high - low) / np.maximum(np.maximum(np.abs(low), np.abs(high)), 1.0)


def _off(squares: Array, s: Array) -> tuple[Array, Array]:
    """How far each profile's edge is from where it should be (..., ACROSS) [pixels], by its squared slopes at s, and
    how far the ends of a line through them (...)."""
    centre = (squares * s).sum(-1) / np.maximum(squares.sum(-1), 1e-9)
    return np.abs(centre - (centre @ BOW)[..., None] * BOW), np.abs(centre @ TURN)


def _ranked(values: Array, share: float) -> Array:
    """Of values (..., n) those (...,) that so large a share is below."""
    rank = int(share * values.shape[-1])
    return np.asarray(np.partition(values, rank, -1)[..., rank])


def _at_border(image: AnyArray, corners: Array, normal: Array) -> BoolArray:
    """Which edges (m, 4) have no image beyond them, at one of their ends at least."""
    ends = np.stack([corners, np.roll(corners, -1, 1)], 2)  # (m, 4, 2 ends, 2)
    outwards = np.sign(np.sum((ends.mean(2) - corners.mean(1)[:, None]) * normal, -1))[..., None] * normal
    beyond = ends + BORDER * outwards[:, :, None]
    height, width = image.shape
    return np.asarray(((beyond < 0.0) | (beyond > [width - 1.0, height - 1.0])).any((-1, -2)))


def grey_at(image: AnyArray, points: Array) -> Array:
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
