"""How well the corners of a tag are known in an image: by the lines that its edges are fitted with.

The AprilTag library places an edge at some points along it, each the centre of the squared grey slopes within two
pixels, and fits a line. A corner is where two of these lines cross. So four lines err, each by itself, and corners err
with them: those of one edge together across it, and none along an edge more than the other edge says.

    points       n = min(L / 1.7, max(16, L / 8)) of an edge of L pixels: nearer ones err by the same pixels
    a point      errs by s w / SHARP where the edge has width w: a blurred edge's slopes are level within two pixels,
                 and their centre errs by the noise over the slope
    a line       through n points errs by 2 s / sqrt(n) at its ends, and there by -1/2 of it together:
                 the mean of n has variance s^2 / n, the turn about it 3 s^2 / n at the ends
    first look   a point is sought within a = 2 pixels of a line that was found before, through whole pixels: of what
                 that errs by a point keeps the share 2 a exp(-a^2 / w^2) / (sqrt(pi) w erf(a / w)), since what of a
                 wide edge's slopes lies within these pixels lies about the line. At its ends it errs by 1/sqrt(12) of a
                 pixel where the edge runs along pixels, and by (FIRST^2 + (STEPS / N)^2)^1/2 where it crosses N of them
    pixels       an edge in focus that runs along pixels is read up to PHASE beside itself, by where between two of them
                 it lies; what is wider has exp(-2 pi^2 (w^2 - SHARP^2)) of it, what crosses N of them 1/N
    neighbours   slopes are spread by v^2 = w^2 + 1/3 (read over two pixels); where the tag's cells are only m pixels
                 wide across the edge, those beside it move its line by w CROWDED exp(-m^2 / (NEAR v^2)) at its ends,
                 and by no more than w MOST. Where a cell has TOLD widths `beside` takes most of that out, and LEFT and
                 LEFT_NEAR are in their places
    a corner     e with n1 . e = d1, n2 . e = d2, the lines' normals n and what they err by there
    all          + floor^2: what does not go away in a large tag, the calibration's own error

s and the floor are stated, not fitted to a map: s is what a camera's noise of grey values makes of a point. FIRST,
STEPS, PHASE and what neighbours do are those of 4,100 single tags before the camera of the virtual lab, of which no
other figure is made.
"""

import numpy as np

from teamslam.frontend.tags.edges import SHARP, cell_widths
from teamslam.geometry import Array

POINTS, EVERY_PX = 16, 8.0  # on an edge, unless it is so long that one every so many pixels is more
SHARED_PX = 1.7  # along an edge, of which points count for one: by a camera's noise, as long as it is alike in them
WITHIN, WHOLE = 2.0, 12.0**-0.5  # pixels to each side; and the deviation of what is rounded to whole pixels
FIRST, STEPS = 0.08, 0.17
PHASE = 0.01
CROWDED, NEAR, MOST = 0.84, 3.3, 0.27
LEFT, LEFT_NEAR = 0.4, 3.7
TOLD = 2.5  # widths of an edge in a cell: with less, what is seen of a cell is what is beside it
FLATTEST = 0.05  # sine of the angle between two edges: with less they cross anywhere
LINE = np.array([[1.0, -0.5], [-0.5, 1.0]])  # how the ends of a line err together


def corner_covariances(corners: Array, floor: float, edge: float, widths: Array | None = None) -> Array:
    """The covariance (m, 8, 8) [pixels^2] of the corners of each tag (m, 4, 2), x and y of the first corner first;
    `floor` and `edge` (s) [pixels] as above. `widths` (m, 4) are those of the edges from each corner to the next: below
    SHARP in focus, CUT where nothing is known of an edge. None for corners that others found, or that a pose implies:
    taken to be in focus, and to err each by itself.
    """
    along = np.roll(corners, -1, 1) - corners
    length = np.maximum(np.linalg.norm(along, axis=-1), 1.0)
    wide = np.full(length.shape, SHARP) if widths is None else np.maximum(widths, SHARP)
    points = np.minimum(length / SHARED_PX, np.maximum(POINTS, length / EVERY_PX))
    line = (2.0 * edge * wide / SHARP) ** 2 / points
    cells = cell_widths(corners)
    told = (cells > TOLD * wide) & (widths is not None)
    most, near = np.where(told, LEFT, CROWDED), np.where(told, LEFT_NEAR, NEAR)
    crowded = wide * np.minimum(most * np.exp(-(cells**2) / (near * (wide**2 + 1.0 / 3.0))), MOST)
    ends = line + (crowded**2 + (_kept(wide) * _first(along)) ** 2) * (edge > 0.0)
    beside = _between_pixels(along, wide) ** 2 * (edge > 0.0)
    lines = ends[..., None, None] * LINE + beside[..., None, None]  # (m, 4, 2, 2)
    J = by_lines(along / length[..., None])
    covariance = np.einsum("mikr,mkrs,mjks->mij", J, lines, J)
    if widths is None:
        covariance *= np.kron(np.eye(4), np.ones((2, 2)))
    return np.asarray(covariance + floor**2 * np.eye(8))


def _kept(wide: Array) -> Array:
    """Which share of what a line erred by at first stays with edges so wide (m, 4) [pixels]."""
    from scipy.special import erf

    u = WITHIN / wide
    return np.asarray(2.0 * u * np.exp(-u * u) / (np.sqrt(np.pi) * erf(u)))


def _first(along: Array) -> Array:
    """What lines through whole pixels err by at their ends (m, 4) [pixels], of edges along (m, 4, 2)."""
    return np.asarray(np.minimum(WHOLE, np.hypot(FIRST, STEPS / _crossed(along))))


def _between_pixels(along: Array, wide: Array) -> Array:
    """By how much lines are beside themselves (m, 4) [pixels], by where between pixels they lie."""
    fades = np.exp(-2.0 * np.pi**2 * np.minimum(wide**2 - SHARP**2, 9.0))
    return np.asarray(PHASE * fades / np.maximum(_crossed(along), 1.0))


def _crossed(along: Array) -> Array:
    """How many lines or columns of pixels edges cross (m, 4)."""
    return np.asarray(np.maximum(np.abs(along).min(-1), 1e-9))


def by_lines(t: Array) -> Array:
    """By how much corners move (m, 8, 4, 2) where each line, along t (m, 4, 2), is moved across at its two ends."""
    before = np.roll(t, 1, 1)
    sine = t[..., 1] * before[..., 0] - t[..., 0] * before[..., 1]
    sine = np.where(sine < 0.0, np.minimum(sine, -FLATTEST), np.maximum(sine, FLATTEST))[..., None]
    J = np.zeros((len(t), 4, 2, 4, 2))
    for k in range(4):
        J[:, k, :, k, 0] = (before / sine)[:, k]
        J[:, k, :, k - 1, 1] = (-t / sine)[:, k]
    return J.reshape(len(t), 8, 4, 2)
